"""The abstract recovery behaviour."""

from __future__ import annotations

import abc
from typing import Any, ClassVar, Iterator, Mapping, Optional

from mbf_relay.control.controller import Controller
from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.plugins import Plugin


class RecoveryContext(abc.ABC):
    """What a behaviour may see and touch; its values are those of the current step."""

    @property
    @abc.abstractmethod
    def now(self) -> float:
        """Time (s)."""

    @property
    @abc.abstractmethod
    def period(self) -> float:
        """Time (s) between two steps."""

    @property
    @abc.abstractmethod
    def velocity(self) -> Twist2D:
        """The robot's velocity, body frame: as told last where commands come late, else from odometry."""

    @abc.abstractmethod
    def pose_in(self, frame: str) -> Pose2D:
        """Return the robot's pose in `frame` when it does what it is told now.

        Raises:
            TransformError: It is not known.
        """

    @property
    @abc.abstractmethod
    def costmaps(self) -> Mapping[str, Any]:
        """The live costmaps (mbf_relay.costmap.costmap.Costmap), "local" and "global"."""

    @property
    @abc.abstractmethod
    def controller(self) -> Optional[Controller]:
        """The controller that failed, or None: a behaviour may change its limits for a while."""


class Recovery(Plugin, abc.ABC):
    """Tries to get the robot going again, step by step, so that it can be cancelled between any two of them.

    Attributes:
        leaves_place: Whether it drives the robot elsewhere; move_base then spares it for what the place can change.
        only_looks_round: Whether all it does for a planner is to turn the sensors round; move_base then leaves it out
            where no path is found and they see all round already.
    """

    leaves_place: ClassVar[bool] = False
    only_looks_round: ClassVar[bool] = False

    @abc.abstractmethod
    def run(self, context: RecoveryContext) -> Iterator[Twist2D]:
        """Yield the velocity to command until the next step; return when done.

        Whoever drives the generator commands less of it, along the same arc, where a zone limits speed, commands a stop
        after its last step, and closes it (GeneratorExit) when cancelled: undo what must not last in a `finally`.

        Raises:
            RecoveryError: IMPASSABLE, TF_ERROR or FAILURE, with a text that says why.
        """

"""The abstract recovery behaviour."""

from __future__ import annotations

import abc
from typing import Any, ClassVar, Iterator, Mapping, Optional

from mbf_relay.control.controller import Controller
from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.plugins import Plugin


class RecoveryContext(abc.ABC):
    """A behaviour's interface to robot, costmaps and controller; its values are those of the current step."""

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
        """The robot's velocity, body frame: from odometry, or the last command where commands take effect late."""

    @abc.abstractmethod
    def pose_in(self, frame: str) -> Pose2D:
        """Return the robot's pose in `frame` at the time when a command of now takes effect.

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
        """The controller that failed, or None; a behaviour may limit its speed."""


class Recovery(Plugin, abc.ABC):
    """A recovery behaviour, run step by step, so that it can be cancelled between any two steps.

    Attributes:
        leaves_place: Whether it drives the robot to another place; move_base then uses it only for failures that a
            change of place can cure.
        only_looks_round: Whether its only use for planning is that the sensors see more; move_base then skips it where
            no path is found and the sensors see all around already.
    """

    leaves_place: ClassVar[bool] = False
    only_looks_round: ClassVar[bool] = False

    @abc.abstractmethod
    def run(self, context: RecoveryContext) -> Iterator[Twist2D]:
        """Yield the velocity to command until the next step; return when done.

        The caller scales the velocity down where a zone limits speed, commands a stop after the last step, and closes
        the generator (GeneratorExit) when cancelled; undo in a `finally` what must not last.

        Raises:
            RecoveryError: IMPASSABLE, TF_ERROR or FAILURE, with a text that says why.
        """

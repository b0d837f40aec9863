"""The abstract critic and the data it scores by."""

from __future__ import annotations

import abc
from dataclasses import dataclass, field
from typing import ClassVar, Dict, Tuple

import numpy as np

from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.trajectories import Trajectories, VelocityWindow
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.plugins import Plugin

RULED_OUT = np.inf
"""Score of a trajectory that must not be driven."""


@dataclass(frozen=True)
class CriticData:
    """The data of one cycle that critics score by.

    Attributes:
        now: Time (s) at which the robot is at `pose`, where trajectories begin: later than the cycle by its delay.
        pose: The robot in the costmap's frame.
        velocity: Present velocity, body frame.
        path: The part of the path near the robot.
        checker: The obstacles.
        window: The dynamic window.
        horizon_scale: Factor on distances looked ahead: 1 in open space, less where the path is narrow.
        measured: Cache of projections on the path, shared by critics: the batch and its result, by the distance (m) of
            the measured point ahead of the robot's centre; see `distances._OnPath`.
    """

    now: float
    pose: Pose2D
    velocity: Twist2D
    path: LocalPath
    checker: FootprintChecker
    window: VelocityWindow
    horizon_scale: float = 1.0
    measured: Dict[float, Tuple[Trajectories, np.ndarray]] = field(default_factory=dict)

    @property
    def width(self) -> float:
        """The robot's width (m)."""
        return self.checker.costmap.width


class Critic(Plugin, abc.ABC):
    """Scores trajectories by one criterion; the trajectory with the lowest sum over all critics wins.

    A critic without a memory implements `scale` and `score`; one with a memory (such as oscillation) also implements
    `driven` and `reset`. Its parameters are the controller's.

    Attributes:
        judges_place: Whether its scores tell how good the place is that a trajectory ends at. A winner that by these
            scores is no better than standing still is not driven: the robot would creep to and fro.
        judges_way: Whether its scores are of what a trajectory passes, which is nothing for standing still. Where such
            costs keep a robot with a free path standing, only what the critic rules out counts.
        yields_where_held: Whether it is left out where its scores keep the robot standing: at a bend, say, the forward
            point may be nearest to the path while the robot stands.
        passes_by_itself: Whether what it rules out for becomes free in time: a robot that stands because of it alone
            waits.
        rules_out_contacts: Whether it rules out collisions; a list of critics without such a one causes a warning.
    """

    Parameters = DwaParameters
    parameters: DwaParameters
    judges_place: ClassVar[bool] = False
    judges_way: ClassVar[bool] = False
    yields_where_held: ClassVar[bool] = False
    passes_by_itself: ClassVar[bool] = False
    rules_out_contacts: ClassVar[bool] = False

    @property
    @abc.abstractmethod
    def scale(self) -> float:
        """Weight of the scores; a critic of weight 0 is not asked."""

    @abc.abstractmethod
    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return the cost of each trajectory, shape (N,): 0 or above, RULED_OUT for one that must not be driven."""

    def driven(self, command: Twist2D, data: CriticData) -> None:
        """Note what is commanded in this cycle."""

    def reset(self) -> None:
        """Forget what was remembered, for a new goal."""

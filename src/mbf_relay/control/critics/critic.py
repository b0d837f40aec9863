"""The abstract critic and what it is shown."""

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


@dataclass(frozen=True)
class CriticData:
    """What every critic may look at in one cycle.

    Attributes:
        now: Time (s) at which the robot is at `pose`, where trajectories begin: later than the cycle by its delay.
        pose: The robot in the costmap's frame.
        velocity: The velocity the robot is at, body frame.
        path: The path round the robot.
        checker: The obstacles.
        window: The velocities in reach.
        horizon_scale: Factor on all lengths looked ahead: 1 in the open, less where it is narrow.
        measured: Where ends of trajectories lie along the path, kept for critics that ask for the same: the batch and
            its figures, by how far (m) ahead of the robot's centre the point lies; see `distances._OnPath`.
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
    """Scores trajectories by one point of view; the lowest sum over all critics wins.

    A critic that remembers nothing implements `scale` and `score`; one that does (the oscillation flags) also hears
    which trajectory was driven, and when the path changed. Its parameters are the controller's.

    Attributes:
        judges_place: Whether its scores tell how good a place a trajectory ends at. A winner that is no better there
            than standing still is not driven: the robot would creep to and fro.
        judges_way: Whether its scores tell what a trajectory passes. Who stands passes nothing, and would never come to
            a narrower place: where that holds a robot whose path is free, only what is ruled out counts.
        yields_where_held: Whether it is left out where its scores hold the robot that could get on: at a bend the
            forward point may be as near to the path as it gets where the robot stands.
        passes_by_itself: Whether what it objects to goes away in time: a robot that it alone holds waits.
        rules_out_contacts: Whether it rules out what touches; who lists no such critic is warned.
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
        """Hear what is commanded in this cycle."""

    def reset(self) -> None:
        """Forget what was remembered: the goal is a new one."""

"""The abstract critic and what it is shown."""

from __future__ import annotations

import abc
from dataclasses import dataclass, field
from typing import Dict, Tuple

import numpy as np

from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.obstacle_view import ObstacleView
from mbf_relay.control.trajectories import Trajectories, VelocityWindow
from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.plugins import Plugin

RULED_OUT = np.inf


@dataclass(frozen=True)
class Scene:
    """What every critic may look at in one cycle.

    Attributes:
        now: Time (s).
        pose: The robot in the costmap's frame.
        velocity: The velocity the robot is at, body frame.
        path: The path round the robot.
        view: The obstacles.
        window: The velocities in reach.
        focus: Factor on all lengths looked ahead: 1 in the open, less where it is narrow.
        measured: Of which trajectories what was measured already, by how far ahead, for critics that measure the same.
    """

    now: float
    pose: Pose2D
    velocity: Twist2D
    path: LocalPath
    view: ObstacleView
    window: VelocityWindow
    focus: float = 1.0
    measured: Dict[float, Tuple[Trajectories, np.ndarray]] = field(default_factory=dict)


class Critic(Plugin, abc.ABC):
    """Scores trajectories by one point of view; the lowest sum over all critics wins.

    A critic that remembers nothing implements `scale` and `score`; one that does (the oscillation flags) also hears
    which trajectory was driven, and when the path changed. Its parameters are the controller's.
    """

    Parameters = DwaParameters

    @property
    @abc.abstractmethod
    def scale(self) -> float:
        """Weight of the scores; a critic of weight 0 is not asked."""

    @abc.abstractmethod
    def score(self, trajectories: Trajectories, scene: Scene) -> np.ndarray:
        """Return the cost of each trajectory, shape (N,): 0 or above, RULED_OUT for one that must not be driven."""

    def driven(self, command: Twist2D, scene: Scene) -> None:
        """Hear what is commanded in this cycle."""

    def reset(self) -> None:
        """Forget what was remembered: the goal is a new one."""

"""Foresight: where what moves will be when the robot gets there."""

from __future__ import annotations

import math
import warnings

import numpy as np

from mbf_relay.control import foresight_kernels
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.tracking.track import as_array

SURENESS = 1.0  # deviations of its place by which a track counts as wider
MOST_SPREAD = 0.05  # m by which it does so at most: what may be anywhere would otherwise be everywhere
WAIT = 0.1  # s between looks at a robot that stands
LEAST_CORNERS = 12  # of the polygon that stands for a round robot
NEAR = 0.5  # robot's widths: what comes nearer than that is bad, too
SPREADING = 1.0  # deviations of its place by which a track is near from farther away
MOST_SPREADING = 1.0  # robot's widths by which it is at most
MEMORY = 4.0  # s ahead after which what is foreseen counts by 1/e: few hold their course for longer
NEARER = 0.002  # m from which on the robot has come nearer to somebody
BETTER = 0.05  # s by which a meeting must come later to be a better one


class Foresight:
    """What is tracked, asked many times within a cycle.

    A trajectory ends with the robot standing there, so that a place in somebody's way is no good end. What touches the
    footprint as it stands, or may, counts as no wider than there is room: from it the robot may go away, not nearer.

    Attributes:
        is_blind: Whether nothing that moves is known, or nobody wants to hear of it: everything is free then.
    """

    def __init__(self, costmap: CostGrid, pose: Pose2D, now: float, parameters: FollowerParameters) -> None:
        self._horizon = parameters.foresight_horizon
        self._tracks = as_array((costmap.tracks or ()) if parameters.foresight else (), now)
        if parameters.foresight and costmap.tracks is None:
            warnings.warn(
                "foresight is on, but no layer of the local costmap tracks moving obstacles; give it "
                "'track_layer: {enabled: true}', or a layer of type mbf_relay::TrackLayer where it lists its plugins",
                RuntimeWarning, stacklevel=1)
        self.is_blind = len(self._tracks) == 0
        self._width = costmap.width
        outline = costmap.footprint
        if len(outline) < 3:
            angles = np.arange(LEAST_CORNERS) * (2.0 * math.pi / LEAST_CORNERS)
            outline = costmap.circumscribed_radius * np.column_stack((np.cos(angles), np.sin(angles)))
        self._outline = np.ascontiguousarray(outline, dtype=float)
        self._rooms = np.empty(len(self._tracks))
        foresight_kernels.rooms_now(self._outline, self._tracks, pose.x, pose.y, pose.theta, self._rooms)

    def meetings(
        self, poses: np.ndarray, counts: np.ndarray, steps: np.ndarray, wider: float = 0.0, horizon: float = 0.0
    ) -> np.ndarray:
        """Return when each trajectory first meets something, shape (N,) in seconds from now; infinite for never.

        Args:
            poses: Shape (N, S, 3), float64, C-contiguous, in the costmap's frame.
            counts: Shape (N,), int64: poses of each trajectory.
            steps: Shape (N,), float64: seconds from pose to pose.
            wider: Metres by which tracks count as wider than they are.
            horizon: Seconds to look ahead; `foresight_horizon` where that is longer.
        """
        times = np.full(len(poses), math.inf)
        if not self.is_blind:
            tracks = self._tracks
            if wider > 0.0:
                tracks = tracks.copy()
                tracks[:, 4] += wider
            foresight_kernels.first_meetings(
                self._outline, tracks, self._rooms, poses, counts, steps, max(self._horizon, horizon), WAIT,
                SURENESS, MOST_SPREAD, times,
            )
        return times

    def runs_into(self, poses: np.ndarray, counts: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Tell on which trajectories somebody could be touched by the robot that comes nearer to him, shape (N,).

        Who walks away may stop or turn back, and it takes half a second to see that. So he may be wherever he gets at
        the speed he has. By a robot that stands by then, or gives way, nobody is run into, whoever touches it.

        Source: Macek, Vasquez Govea, Fraichard, Siegwart, "Towards safe vehicle navigation in dynamic urban scenarios"
        (2009), for passive safety: a robot that cannot keep others from touching it at least stands when they do.

        Args:
            poses, counts, steps: As for `meetings`; till the robot stands.
        """
        found = np.zeros(len(poses), np.bool_)
        if not self.is_blind:
            foresight_kernels.runs_into(self._outline, self._tracks, self._rooms, poses, counts, steps, NEARER, found)
        return found

    @property
    def outline(self) -> np.ndarray:
        """The footprint, shape (C, 2); a polygon for a round robot, too."""
        return self._outline

    def exposures(self, poses: np.ndarray, step: float) -> np.ndarray:
        """Return for how long (s) each trajectory is touched or near to be, which counts less, shape (N,).

        Args:
            poses: Shape (N, S, 3), float64, C-contiguous, in the costmap's frame.
            step: Seconds from pose to pose.
        """
        sums = np.empty(len(poses))
        foresight_kernels.exposures(
            self._outline, self._tracks, self._rooms, poses, step, NEAR * self._width, SPREADING,
            MOST_SPREADING * self._width, MEMORY, sums)
        return sums

    def lay(self, x: float, y: float, cell: float, layer: float, radius: float, dangers: np.ndarray) -> None:
        """Tell how bad it is to be where and when; see foresight_kernels.lay for the arguments."""
        foresight_kernels.lay(
            self._tracks, x, y, cell, layer, radius, NEAR * self._width, SPREADING, MOST_SPREADING * self._width,
            MEMORY, dangers)

    def meeting_of_standing(self, pose: Pose2D) -> float:
        """Return when the robot is met (s from now) if it stands where it is."""
        return float(self.meetings(np.array([[pose]], dtype=float), np.ones(1, np.int64), np.full(1, WAIT))[0])

    def costs(self, meetings: np.ndarray, stopping: np.ndarray, pose: Pose2D) -> np.ndarray:
        """Return what meetings cost, shape (N,): 0 for none in sight to 1 for one now.

        Infinite where the robot could not stop before, unless it would be met no later where it stands.

        Args:
            meetings: Shape (N,), from `meetings`.
            stopping: Shape (N,): seconds each needs to stop.
            pose: The robot now.
        """
        costs = np.maximum(0.0, 1.0 - meetings / self._horizon)
        late = (meetings <= stopping) & (meetings <= self.meeting_of_standing(pose) + BETTER)
        return np.where(late, math.inf, costs)

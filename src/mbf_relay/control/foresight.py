"""Foresight: contacts of trajectories with tracked obstacles, predicted at constant velocity."""

from __future__ import annotations

import math
import warnings

import numpy as np

from mbf_relay.control import foresight_kernels
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.tracking.track import as_array

SURENESS = 1.0  # standard deviations of its position by which a track's radius is enlarged
MOST_SPREAD = 0.05  # m: limit of that, since uncertain tracks would block everything
WAIT = 0.1  # s between checks of a robot that stands at a trajectory's end
LEAST_CORNERS = 12  # corners of the polygon used for a round robot
NEAR = 0.5  # robot's widths of clearance below which nearness is charged, too
SPREADING = 1.0  # standard deviations of a track's position added to that clearance
MOST_SPREADING = 1.0  # robot's widths: limit of that
MEMORY = 4.0  # s after which predictions count by 1/e: few people keep their course for longer
NEARER = 0.002  # m by which the robot must approach a track to count as coming nearer
BETTER = 0.05  # s by which a contact must come later than that of standing still to be better


class Foresight:
    """The tracks of one cycle, predicted, for checks of many trajectories.

    After its last pose a trajectory is taken to stand there, so that places in somebody's way are no good ends. A track
    that touches the footprint now is taken as no wider than its distance: the robot may move away from it, not nearer.

    Attributes:
        is_blind: Whether there are no tracks, or the parameter `foresight` is off: everything is free then.
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
        """Return the time (s) of each trajectory's first contact with a track, shape (N,); infinite for none.

        Args:
            poses: Shape (N, S, 3), float64, C-contiguous, in the costmap's frame.
            counts: Shape (N,), int64: poses of each trajectory.
            steps: Shape (N,), float64: time (s) between poses.
            wider: Metres added to the tracks' radii.
            horizon: Prediction time (s); `foresight_horizon` where that is longer.
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
        """Return on which trajectories the robot could touch somebody while it approaches, bool of shape (N,).

        A person may stop or turn back, which takes the tracker half a second to see. So each track may be anywhere it
        gets at its present speed. A robot that stands by then, or moves away, does not count as running into anybody.

        Source: Macek, Vasquez Govea, Fraichard, Siegwart, "Towards safe vehicle navigation in dynamic urban scenarios"
        (2009), for passive safety: a robot that cannot keep others from touching it at least stands when they do.

        Args:
            poses, counts, steps: As for `meetings`, up to a stop.
        """
        found = np.zeros(len(poses), np.bool_)
        if not self.is_blind:
            foresight_kernels.runs_into(self._outline, self._tracks, self._rooms, poses, counts, steps, NEARER, found)
        return found

    @property
    def outline(self) -> np.ndarray:
        """The footprint, shape (C, 2) in metres in the base frame; a polygon for a round robot, too."""
        return self._outline

    def exposures(self, poses: np.ndarray, step: float) -> np.ndarray:
        """Return the time (s) each trajectory is in contact with tracks, or near them with less weight, shape (N,).

        Args:
            poses: Shape (N, S, 3), float64, C-contiguous, in the costmap's frame.
            step: Time (s) between poses.
        """
        sums = np.empty(len(poses))
        foresight_kernels.exposures(
            self._outline, self._tracks, self._rooms, poses, step, NEAR * self._width, SPREADING,
            MOST_SPREADING * self._width, MEMORY, sums)
        return sums

    def lay(self, x: float, y: float, cell: float, layer: float, radius: float, dangers: np.ndarray) -> None:
        """Fill a grid in space and time with the danger of contact; see foresight_kernels.lay for the arguments."""
        foresight_kernels.lay(
            self._tracks, x, y, cell, layer, radius, NEAR * self._width, SPREADING, MOST_SPREADING * self._width,
            MEMORY, dangers)

    def meeting_of_standing(self, pose: Pose2D) -> float:
        """Return the time (s) of the first contact of a robot that stands at `pose`; infinite for none."""
        return float(self.meetings(np.array([[pose]], dtype=float), np.ones(1, np.int64), np.full(1, WAIT))[0])

    def costs(self, meetings: np.ndarray, stopping: np.ndarray, pose: Pose2D) -> np.ndarray:
        """Return the costs of contacts, shape (N,): from 0 for none within the horizon to 1 for one now.

        Infinite where the robot could not stop before the contact, unless standing still is met sooner by BETTER.

        Args:
            meetings: Shape (N,), from `meetings`.
            stopping: Shape (N,): time (s) that each needs to stop.
            pose: The robot's pose.
        """
        costs = np.maximum(0.0, 1.0 - meetings / self._horizon)
        late = (meetings <= stopping) & (meetings <= self.meeting_of_standing(pose) + BETTER)
        return np.where(late, math.inf, costs)

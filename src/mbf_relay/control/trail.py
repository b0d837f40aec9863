"""The poses the robot has driven through lately, and the way back along them."""

from __future__ import annotations

import math
from typing import Optional

import numpy as np

from mbf_relay.control import path_kernels
from mbf_relay.control.way import Way
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D, normalize_angles

APART = 2.5  # spacing of the poses noted, in the checker's steps: half a cell, the accuracy of obstacles
MOST = 256  # poses noted: longer than the way across a local costmap


class Trail:
    """Notes poses, and how deep the footprint lay in occupied cells there.

    A robot that passes an obstacle closely may overlap its cells in the costmap. It can go on, since it may keep
    touching what it touches already; but on the way back, from where it touches nothing, the same cells would block
    it. As it was there already, overlap up to the depth noted is allowed on the way back.
    """

    def __init__(self) -> None:
        self._noted = np.empty((0, 5))  # x, y (m), theta (rad), and the two depths of each pose
        self._frame: Optional[str] = None

    def note(self, pose: Pose2D, checker: FootprintChecker) -> None:
        """Note the robot's pose (costmap's frame); where it returns to an earlier one, what lies between is dropped."""
        frame, noted = checker.costmap.frame, self._noted
        if len(noted) and (
                frame != self._frame or math.dist(noted[-1, :2].tolist(), pose[:2]) > checker.costmap.width):
            noted = noted[:0]  # another frame, or the pose jumped
        self._frame = frame
        depths = checker.depths_at(pose)
        first = path_kernels.first_near(noted, *pose, APART * checker.step, APART * checker.turn_step)
        if first >= 0:
            self._noted = noted[:first + 1]
            self._noted[first, 3:] = np.maximum(self._noted[first, 3:], depths)
        else:
            self._noted = np.vstack((noted[1 - MOST:], (*pose, *depths)))

    def way_back(self, pose: Pose2D, checker: FootprintChecker) -> Way:
        """Return the way back from `pose`, where the robot is; of one pose alone if nothing was noted."""
        if not len(self._noted):
            return Way(np.array([pose]), np.full((1, 2), -1.0), checker.costmap.width)
        corners = np.vstack((pose, self._noted[-2::-1, :3]))
        moves = np.diff(corners, axis=0)
        moves[:, 2] = normalize_angles(moves[:, 2])
        counts = np.ceil(np.maximum(
            np.hypot(moves[:, 0], moves[:, 1]) / (2.0 * checker.step), np.abs(moves[:, 2]) / (2.0 * checker.turn_step)))
        which = np.repeat(np.arange(len(moves)), counts.astype(np.int64))
        share = (np.arange(len(which)) - np.concatenate(([0.0], np.cumsum(counts)[:-1]))[which] + 1.0) / counts[which]
        poses = np.vstack((corners[:1], corners[which] + share[:, None] * moves[which]))
        return Way(poses, self._noted[::-1, 3:][np.append(0, which + 1)], checker.costmap.width)

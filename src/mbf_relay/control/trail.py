"""The trail: where a robot has been of late, and the way back along it, which was free when it came."""

from __future__ import annotations

from typing import Optional

import numpy as np

from mbf_relay.control.way import Way
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D, normalize_angles

APART = 2.5  # checked steps between poses noted: half a cell, as exactly as obstacles are known
MOST = 256  # poses noted: more way than a local costmap shows


class Trail:
    """Notes poses, and how deep the footprint lay in marks there.

    A costmap has marks where a robot that passed them by a hair has been. It came in because what it touches already
    it may go on touching; once it touches nothing they would shut it in. It has been there, so they are not in its
    way, as long as they are what they were.
    """

    def __init__(self) -> None:
        self._poses = np.empty((0, 3))
        self._depths = np.empty((0, 2))
        self._frame: Optional[str] = None

    def note(self, pose: Pose2D, checker: FootprintChecker) -> None:
        """Note where the robot is; a loop it has driven is left out."""
        away = self._poses - pose
        distances = np.hypot(away[:, 0], away[:, 1])
        if len(away) and (checker.costmap.frame != self._frame or distances[-1] > checker.costmap.width):
            self.__init__()  # type: ignore[misc]  # set down elsewhere
            away, distances = away[:0], distances[:0]
        self._frame = checker.costmap.frame
        depths = checker.depths_at(pose)
        near = np.flatnonzero(distances < APART * checker.step)
        near = near[np.abs(normalize_angles(away[near, 2])) < APART * checker.turn_step]
        if len(near):
            first = int(near[0])
            self._poses, self._depths = self._poses[:first + 1], self._depths[:first + 1]
            self._depths[first] = np.maximum(self._depths[first], depths)
        else:
            self._poses = np.vstack((self._poses[1 - MOST:], pose))
            self._depths = np.vstack((self._depths[1 - MOST:], depths))

    def way_back(self, pose: Pose2D, checker: FootprintChecker) -> Way:
        """Return the way back from the pose noted last, where the robot is; where none was, there is none."""
        if not len(self._poses):
            return Way(np.array([pose]), np.full((1, 2), -1.0), checker.costmap.width)
        corners = np.vstack((pose, self._poses[-2::-1]))
        moves = np.diff(corners, axis=0)
        moves[:, 2] = normalize_angles(moves[:, 2])
        counts = np.ceil(np.maximum(
            np.hypot(moves[:, 0], moves[:, 1]) / (2.0 * checker.step), np.abs(moves[:, 2]) / (2.0 * checker.turn_step)))
        which = np.repeat(np.arange(len(moves)), counts.astype(np.int64))
        share = (np.arange(len(which)) - np.concatenate(([0.0], np.cumsum(counts)[:-1]))[which] + 1.0) / counts[which]
        poses = np.vstack((corners[:1], corners[which] + share[:, None] * moves[which]))
        return Way(poses, self._depths[::-1][np.append(0, which + 1)], checker.costmap.width)

#!/usr/bin/env python3
"""A wrong initial pose, put right with RViz's 2D Pose Estimate; then a clicked goal is reached."""

import math
import os
import sys

import rostest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

from clicking import ClickingTest, start  # noqa: E402
from ros_testing import wait_until  # noqa: E402

from mbf_relay.geometry import Pose2D  # noqa: E402


class TestWrongStart(ClickingTest):
    def test_a_wrong_pose_is_put_right_by_clicking(self):
        self.assertGreater(self.believed_pose.distance_to(self.true_pose), 2.0, "the start was to be wrong")
        self.click_pose(self.true_pose)
        wait_until(
            lambda: self.believed_pose.distance_to(self.true_pose) < 0.5, "localization to take the clicked pose"
        )
        self.assert_reaches(self.click_goal(Pose2D(-1.75, 0.74, math.radians(65))))


if __name__ == "__main__":
    start()
    rostest.rosrun("mbf_relay", "rviz_wrong_start", TestWrongStart)

#!/usr/bin/env python3
"""2D Pose Estimate and 2D Nav Goal, clicked in RViz: the robot drives to the clicked pose."""

import math
import os
import re
import sys

import rostest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

from clicking import RESULTS, ClickingTest, start  # noqa: E402

from mbf_relay.geometry import Pose2D  # noqa: E402

EXPECTED = (
    # Debian's RViz asks for a package that Debian does not have.
    r"\[rospack\] Error: no such package media_export\s*\[librospack\]: error while executing command",
    # RViz draws maps with two kinds of texture in one shader, which software renderers remark upon and then draw.
    r"\[ERROR\][^\n]*indexed_8bit_image\.vert\n[^\n]*\n\s*GLSL link result :\s*active samplers with a different type[^\n]*",  # noqa: E501
)


class TestGoal(ClickingTest):
    def test_1_the_robot_drives_to_the_clicked_pose(self):
        self.click_pose(self.true_pose)
        self.assert_reaches(self.click_goal(Pose2D(-1.75, 0.74, math.radians(65))))

    def test_2_rviz_complains_of_nothing_it_shows(self):
        with open(os.path.join(RESULTS, "rviz.log"), encoding="utf-8", errors="replace") as stream:
            log = stream.read()
        for expected in EXPECTED:
            log = re.sub(expected, "", log)
        self.assertFalse(re.search(r"ERROR|[Ee]rror", log), log)


if __name__ == "__main__":
    start()
    rostest.rosrun("mbf_relay", "rviz_goal", TestGoal)

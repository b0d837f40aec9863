"""A robot that touches the grid's edge by a rounding error."""

import math

import numpy as np

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid


def test_a_robot_whose_hull_is_past_the_edge_by_a_rounding_error_is_not_judged_by_a_cell_of_the_other_side():
    """What lies past a row's last cell in memory is the next row's first one, and past the last row nobody's."""
    width, resolution, radius = 40, 0.1, 0.17
    corners = np.linspace(0.0, 2.0 * math.pi, 16, endpoint=False)
    outline = radius * np.column_stack((np.cos(corners), np.sin(corners)))
    checker = FootprintChecker(CostGrid(
        Grid(resolution, 0.0, 0.0, width, width), np.zeros((width, width), np.uint8), "map", outline, 0.1, radius))
    past = 0
    headings = len(checker._outlines)
    for heading in range(headings):
        for gap in 10.0 ** np.arange(-12.0, -7.0, 0.1):
            pose = Pose2D(width * resolution - checker._radius - gap, 2.0, 2.0 * math.pi * heading / headings)
            reached = pose.x / resolution + 1.0 / resolution * checker._outlines[heading, :, 0].astype(float).max()
            drive = np.array([[pose, pose]])
            free = checker.first_contacts(drive, np.array([2]), np.ones(1)).steps[0]
            if reached >= width:
                past += 1
                assert checker.contacts_at(pose) > 0 and free == 0, gap
            else:
                assert checker.contacts_at(pose) == 0 and free == 2, gap
    assert past > 10

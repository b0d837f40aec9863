"""How old what a robot drives by may be."""

from types import SimpleNamespace

import pytest

from mbf_relay.navigation.parameters import NavigatorParameters


@pytest.mark.parametrize("values, tolerances, oldest", [
    ({}, (), 1.0), ({}, (0.3, 0.3), 1.0), ({}, (0.3, 2.0), 2.0),
    ({"pose_timeout": 0.5}, (0.3, 2.0), 0.5), ({"pose_timeout": 3.0}, (0.3,), 3.0)])
def test_a_robot_whose_costmaps_take_its_late_poses_drives_by_them_as_under_move_base(values, tolerances, oldest):
    """On a slow machine, with amcl 1.4 s late and a transform_tolerance of 2 s, each goal was given up after 1 s."""
    costmaps = [SimpleNamespace(parameters=SimpleNamespace(transform_tolerance=each)) for each in tolerances]
    assert NavigatorParameters(**values).oldest_pose(costmaps) == oldest

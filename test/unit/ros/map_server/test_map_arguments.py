"""The command lines by which launch files name a map, as map_server reads them."""

import numpy as np
import pytest
import rospy

from mbf_relay.geometry import Pose2D
from mbf_relay.maps import OccupancyMap, save_map
from mbf_relay.ros.map_server.node import read_arguments


@pytest.fixture()
def saved(tmp_path):
    """The YAML file and the image of a map of 3 x 2 cells of 0.2 m."""
    occupancy = OccupancyMap(np.array([[0, 100, -1], [100, 0, 0]], dtype=np.int8), 0.2, Pose2D(1.0, -2.0, 0.0))
    return [str(path) for path in save_map(str(tmp_path / "small"), occupancy)]


@pytest.mark.parametrize("left_standing", ["my_map_resolution", "0"])
def test_a_map_is_served_beside_the_tutorials_word_for_a_resolution(saved, left_standing):
    yaml_path, _image = saved
    occupancy = read_arguments([yaml_path, left_standing])
    assert (occupancy.resolution, occupancy.origin.x) == (0.2, 1.0)


def test_an_image_with_a_resolution_is_a_map(saved, monkeypatch):
    _yaml, image = saved
    monkeypatch.setattr(rospy, "get_param", lambda _name, default: default)
    occupancy = read_arguments([image, "0.05"])
    assert (occupancy.resolution, occupancy.origin.x) == (0.05, 0.0)


def test_an_image_with_a_word_for_its_resolution_is_refused_by_that_word(saved):
    _yaml, image = saved
    with pytest.raises(ValueError, match="my_map_resolution"):
        read_arguments([image, "my_map_resolution"])

"""Drives past zones: round the ones kept out of, slowly through the slow ones, on one clock without ROS."""

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")

from PIL import Image

from mbf_relay.costmap.factory import layer_groups
from mbf_relay.geometry import Pose2D
from mbf_relay.lockstep import config_folder
from mbf_relay.lockstep.episode import Episode
from mbf_relay.lockstep.setup import make_setup
from mbf_relay.lockstep.tasks import EpisodeTask
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import Body, Box
from mbf_relay.simulation.world import World

RESOLUTION = 0.05
LEFT, BOTTOM, SIDE = -3.0, -3.0, 120


def mask_file(folder, value, x0, x1, y0, y1):
    """Write a mask whose rectangle has a value of 0 to 100, in map_server's raw mode, and return its YAML file."""
    pixels = np.zeros((SIDE, SIDE), np.uint8)
    columns = slice(*(int((x - LEFT) / RESOLUTION) for x in (x0, x1)))
    rows = slice(*(SIDE - int((y - BOTTOM) / RESOLUTION) for y in (y1, y0)))
    pixels[rows, columns] = value
    Image.fromarray(pixels).save(folder / "mask.png")
    path = folder / "mask.yaml"
    path.write_text(
        f"{{image: mask.png, resolution: {RESOLUTION}, origin: [{LEFT}, {BOTTOM}, 0.0], negate: 0, mode: raw,"
        " occupied_thresh: 0.65, free_thresh: 0.196}\n", encoding="utf-8")
    return path


def hall():
    """A hall of 6 m with nothing in it, to be crossed along x."""
    walls = [
        Body(f"wall_{index}", Box((0.2, 6.2, 1.0)), Frame.of(3.0 * np.cos(turn), 3.0 * np.sin(turn), 0.5, yaw=turn))
        for index, turn in enumerate(np.arange(4) * np.pi / 2.0)
    ]
    start = Pose2D(-2.0, 0.0, 0.0)
    return EpisodeTask("hall", World("hall", tuple(walls), start), (Pose2D(2.0, 0.0, 0.0),), 90.0)


def drive(kind, path, sides=("global_costmap", "local_costmap"), controller="", **group):
    """Cross the hall with a filter in these costmaps; return result and way: rows of time, x, y, heading."""
    setup = make_setup(config_folder(), localization="truth", controller=controller)
    for side in sides:
        values = setup.settings["move_base_flex"][side]
        layers = layer_groups(values)
        layers.insert(-1, ("zones", f"nav2_costmap_2d::{kind}", {"filter_mask_file": str(path), **group}))
        values["plugins"] = [{"name": name, "type": type_name} for name, type_name, _values in layers]
        values.update({name: own for name, _type_name, own in layers})
    result = Episode(hall(), setup, seed=1).run()
    assert result.success and result.contacts == 0, f"{result.outcome}: {result.message}"
    return np.asarray(result.trajectory)


def test_a_robot_goes_round_where_it_is_kept_out(tmp_path):
    way = drive("KeepoutFilter", mask_file(tmp_path, 100, -0.5, 0.5, -1.0, 1.0))
    inside = (abs(way[:, 1]) < 0.5) & (abs(way[:, 2]) < 1.0)
    assert not inside.any() and abs(way[:, 2]).max() > 1.0


@pytest.mark.parametrize("group, top", [({}, 0.5 * 0.22), ({"type": 2, "base": 0.12, "multiplier": -0.0008}, 0.08)])
def test_a_robot_is_slow_in_the_zone_and_fast_before_and_behind_it(tmp_path, group, top):
    way = drive("SpeedFilter", mask_file(tmp_path, 50, -1.0, 1.0, -2.0, 2.0), ("global_costmap",), **group)
    speeds = np.hypot(*np.diff(way[:, 1:3], axis=0).T) / np.diff(way[:, 0])
    x = way[1:, 1]
    assert speeds[(x > -0.8) & (x < 0.9)].max() < 1.1 * top
    for fast in (speeds[x < -1.1], speeds[x > 1.3]):
        assert fast.max() > 0.2

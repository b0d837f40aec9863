"""Which maps a costmap's node waits for before the robot may drive, and what it says while it waits."""

import threading
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from scan_source import StillFrames

from mbf_relay.costmap.cost_grid import LETHAL
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.maps import OccupancyMap
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common.conversions import map_to_message
from mbf_relay.ros.common.throttled_warnings import ThrottledWarnings
from mbf_relay.ros.costmap import inputs, node, publisher


@pytest.fixture(autouse=True)
def no_graph(monkeypatch):
    monkeypatch.setattr(inputs.rospy, "Subscriber", lambda *_, **__: None)
    monkeypatch.setattr(publisher.rospy, "Publisher", mock.MagicMock())
    monkeypatch.setattr(node.rospy, "get_time", lambda: 1.0)


def make(frames=StillFrames, **layer):
    """Return the node of a costmap of one layer."""
    group = {"update_frequency": 5.0, "global_frame": "map", "plugins": [{"name": "floor", "type": layer.pop("type")}]}
    return node.CostmapNode("global_costmap", {"global_costmap": {**group, "floor": layer}}, frames())


@pytest.mark.parametrize("kind", ["costmap_2d::StaticLayer", "nav2_costmap_2d::KeepoutFilter"])
def test_a_robot_does_not_wait_for_the_map_of_a_layer_that_is_switched_off(kind):
    """move_base took no goals until somebody published the map that its costmap leaves out."""
    made = {enabled: make(type=kind, enabled=enabled) for enabled in (True, False)}
    for each in made.values():
        each.costmap.update(1.0, IDENTITY)
    assert "has come on topic" in made[True].missing_input()
    assert made[False].missing_input() == ""


class LostFrames(StillFrames):
    """Frames of a robot that knows its place, and not that of the frame "site" before `site` is set."""

    site = None

    def lookup(self, target, source, **_):
        if "site" not in (target, source):
            return IDENTITY
        if self.site is None:
            raise TransformError(f"no transform from '{source}' to '{target}'")
        return self.site


@pytest.fixture
def zoned(monkeypatch):
    """A costmap of 10 m with a mask of 1 m in the frame "site", closed all over, and what its node warned of."""
    mask = OccupancyMap(np.full((10, 10), 100, np.int8), 0.1, IDENTITY)
    monkeypatch.setattr("mbf_relay.costmap.costmap_filter.load_map", lambda _path: mask)
    made = make(LostFrames, type="nav2_costmap_2d::KeepoutFilter", filter_mask_file="zones.yaml",
                filter_mask_frame="site")
    monkeypatch.setattr(made, "_publisher", mock.MagicMock())
    monkeypatch.setattr(made, "_tracks", mock.MagicMock())
    now, said = [100.0], []
    for name in ("_pose_warnings", "_stale_warnings", "_map_warnings"):
        monkeypatch.setattr(
            made, name, ThrottledWarnings(lambda: now[0], lambda _, text: said.append(text)), raising=False)

    def update(until):
        while now[0] < until:
            now[0] += 0.2
            made._update(now[0])

    return made, update, said


def closed(made):
    """Return the centre (m) of what the mask closes, shape (2,); NaN where it closes nothing."""
    picture = made.costmap.snapshot()
    cells = np.argwhere(picture.costs == LETHAL)[:, ::-1]
    return picture.grid.centers_of(cells).mean(axis=0) if len(cells) else np.full(2, np.nan)


def test_a_robot_does_not_drive_by_zones_whose_place_is_not_known(zoned):
    """They were taken to lie where the mask's numbers do in the costmap's own frame."""
    made, update, _said = zoned
    update(105.0)
    assert np.isnan(closed(made)).all() and "layer 'floor'" in made.costmap.stale_reason(105.0)
    made._transforms.site = Pose2D(-2.0, -1.0, 0.0)
    update(106.0)
    assert closed(made) == pytest.approx([2.5, 1.5], abs=0.05) and made.costmap.stale_reason(106.0) is None
    made._transforms.site = None
    update(110.0)
    assert closed(made) == pytest.approx([2.5, 1.5], abs=0.05) and made.costmap.stale_reason(110.0) is None


def test_a_frame_of_zones_that_does_not_exist_is_told(zoned):
    """Not a word came: the robot's pose, known each time, ended the trouble before it had lasted."""
    _made, update, said = zoned
    update(130.0)
    assert said and all("layer 'floor'" in text and "'site'" in text for text in said)


@pytest.mark.parametrize("enabled", [True, False])
def test_a_map_of_a_layer_that_is_switched_off_needs_no_place(monkeypatch, enabled):
    """Every 5 s came the warning that its map cannot be placed, which nobody uses."""
    made = make(LostFrames, type="nav2_costmap_2d::KeepoutFilter", enabled=enabled)
    made._maps = [SimpleNamespace(layer="floor", frame="site")]
    monkeypatch.setattr(made, "_map_warnings", mock.MagicMock())
    assert made._place_maps() is not enabled
    assert made._map_warnings.say.called is enabled


def test_a_layer_that_is_switched_on_during_an_update_is_shown_where_its_map_lies(zoned):
    """For a cycle, its zones lay as if their frame were the costmap's."""
    made, update, _said = zoned
    made._transforms.site = Pose2D(-2.0, -1.0, 0.0)
    parameters = made.costmap.layers[0].parameters
    made.costmap.reconfigure_layer("floor", parameters.replace(enabled=False))
    made._sensors = {"scan": SimpleNamespace(
        feed=lambda _now: made.costmap.reconfigure_layer("floor", parameters))}
    update(100.1)
    assert closed(made) == pytest.approx([2.5, 1.5], abs=0.05)


@pytest.mark.parametrize("areas, is_placed", [([], True), ([[1.0, 1.0]], False)])
def test_a_robot_without_a_map_does_not_wait_for_the_place_of_zones_that_there_are_none_of(areas, is_placed):
    """With a prohibition layer whose areas were never loaded, one that knows odometry alone stood for good."""
    made = make(LostFrames, type="costmap_prohibition_layer_namespace::CostmapProhibitionLayer",
                prohibition_frame="site", prohibition_areas=areas)
    assert made._place_maps() == is_placed


def test_each_map_whose_place_is_not_known_is_named():
    """Who put the frame right that was named was then told of the next one, and of the one after."""
    layers = [{"name": name, "type": "nav2_costmap_2d::KeepoutFilter"} for name in ("rooms", "stairs")]
    made = node.CostmapNode("global_costmap", {"global_costmap": {"global_frame": "map", "plugins": layers}},
                            LostFrames())
    made._maps = [SimpleNamespace(layer=each["name"], frame="site") for each in layers]
    assert not made._place_maps()
    told = made.costmap.stale_reason(1.0)
    assert "layer 'rooms'" in told and "layer 'stairs'" in told


def test_a_map_that_comes_during_an_update_is_not_shown_where_its_frame_is_not(monkeypatch):
    """For a cycle, walls lay as if their frame were the costmap's, and the robot was allowed to drive by them."""
    layers = [{"name": "floor", "type": "costmap_2d::StaticLayer"}]
    made = node.CostmapNode("local_costmap", {"local_costmap": {
        "global_frame": "map", "rolling_window": True, "width": 8.0, "height": 8.0, "plugins": layers}}, LostFrames())
    for part in ("_publisher", "_tracks"):
        monkeypatch.setattr(made, part, mock.MagicMock())
    made._transforms.site = Pose2D(-2.0, -1.0, 0.0)
    made._maps.append(inputs.MapInput(
        "floor", made.costmap.layers[0].map_source, made.costmap, lambda: None, made._placing))
    walls = map_to_message(OccupancyMap(np.full((10, 10), 100, np.int8), 0.1, IDENTITY), "site", 0.0)
    comes = threading.Thread(target=made._maps[0]._take_map, args=[walls])

    def come(_now):
        comes.start()
        comes.join(0.2)  # it may have to wait for the update's end

    made._sensors = {"scan": SimpleNamespace(feed=come)}
    made._update(100.0)
    assert np.isnan(closed(made)).all()
    comes.join()
    made._sensors = {}
    made._update(100.2)
    assert closed(made) == pytest.approx([2.5, 1.5], abs=0.05)

"""The track layer: what moves is no wall to who plans, and what stands is one."""

import dataclasses
import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL, Window
from mbf_relay.costmap.factory import build_costmap
from mbf_relay.costmap.observation import Observation, observation_from_points, observation_from_scan, scan_points
from mbf_relay.costmap.track_layer import TrackLayer, TrackLayerParameters
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.scan import LaserScan
from mbf_relay.tracking.tracker import Tracker

BEAMS, REACH = 360, 3.0


def costmap_of(**track_layer):
    return build_costmap("global_costmap", {
        "global_frame": "odom", "width": 5.0, "height": 5.0, "origin_x": -2.5, "origin_y": -2.5, "resolution": 0.05,
        "robot_radius": 0.1, "obstacle_range": 3.0, "raytrace_range": 3.0, "observation_sources": "scan",
        "scan": {"data_type": "LaserScan", "marking": True, "clearing": True}, "track_layer": track_layer,
    })


def scan(discs, stamp):
    """Return what a lidar at the origin sees of discs (x, y, radius)."""
    angles = np.arange(BEAMS) * 2.0 * math.pi / BEAMS
    dx, dy = np.cos(angles), np.sin(angles)
    ranges = np.full(BEAMS, REACH)
    for cx, cy, radius in discs:
        along = cx * dx + cy * dy
        inside = along ** 2 - cx ** 2 - cy ** 2 + radius ** 2
        reached = np.where((inside > 0.0) & (along > 0.0), along - np.sqrt(np.maximum(0.0, inside)), math.inf)
        ranges = np.minimum(ranges, reached)
    return Observation((0.0, 0.0), np.column_stack((ranges * dx, ranges * dy)), ranges < REACH, stamp)


def watch(costmap, world, seconds):
    """Return the snapshot after a while of scans at 5 Hz."""
    for step in range(int(seconds * 5.0) + 1):
        now = 0.2 * step
        costmap.observe("scan", scan(world(now), 10.0 + now), 10.0 + now)
        costmap.update(10.0 + now, Pose2D(0.0, 0.0, 0.0))
    return costmap.snapshot()


def is_marked(snapshot, x, y, radius):
    """Return whether an obstacle is marked on a disc."""
    rows, columns = np.nonzero(snapshot.costs == LETHAL)
    centers_x = snapshot.grid.origin_x + (columns + 0.5) * snapshot.grid.resolution
    centers_y = snapshot.grid.origin_y + (rows + 0.5) * snapshot.grid.resolution
    return bool((np.hypot(centers_x - x, centers_y - y) < radius + 0.05).any())


def crossing(now):
    """Return a post, and somebody who walks by till he stops after six seconds."""
    return [(-1.0, 0.5, 0.1), (1.0, -1.0 + 0.25 * min(now, 6.0), 0.12)]


def test_a_snapshot_asked_for_again_tells_what_moves_now():
    costmap = costmap_of()
    watch(costmap, crossing, 2.0)
    before = costmap.snapshot()
    assert costmap.snapshot() is before, "nothing has changed"
    costmap.observe("scan", scan(crossing(2.2), 12.2), 12.2)  # no update shows it yet, but the track has gone on
    (earlier,), (later,) = before.tracks, costmap.snapshot().tracks
    assert later.y > earlier.y and later.stamp > earlier.stamp


def test_a_snapshot_asked_for_again_has_the_footprint_of_now():
    costmap = costmap_of()
    costmap.update(10.0, Pose2D(0.0, 0.0, 0.0))
    before = costmap.snapshot()
    costmap.set_footprint(2.0 * before.footprint)
    assert costmap.snapshot().circumscribed_radius > 1.5 * before.circumscribed_radius
    costmap.reconfigure(costmap.parameters.replace(obstacle_overlap=0.0))
    assert (before.obstacle_overlap, costmap.snapshot().obstacle_overlap) == (0.2, 0.0)
    costmap.update(10.1, Pose2D(0.0, 0.0, 0.0))
    assert (before.stamp, costmap.snapshot().stamp) == (10.0, 10.1)


@pytest.mark.parametrize("seconds", [2.0, 4.0, 5.0])
def test_who_walks_by_is_no_wall_to_who_plans_and_a_post_is_one(seconds):
    snapshot = watch(costmap_of(mark_movers=False), crossing, seconds)
    assert len(snapshot.tracks) == 1
    assert not is_marked(snapshot, 1.0, -1.0 + 0.25 * seconds, 0.12) and is_marked(snapshot, -1.0, 0.5, 0.1)


def test_a_snapshot_with_somebody_in_it_tells_whether_the_robot_looks_all_round():
    """By that it flees backwards, or does not."""
    costmap = costmap_of()
    assert watch(costmap, crossing, 4.0).sees_all_round
    ahead = scan(crossing(4.2), 14.2)
    points = ahead.points[ahead.points[:, 0] > 0.0]
    costmap.observe("scan", Observation((0.0, 0.0), points, np.hypot(*points.T) < REACH, 14.2), 14.2)
    costmap.update(14.2, Pose2D(0.0, 0.0, 0.0))
    assert costmap.snapshot().tracks and not costmap.snapshot().sees_all_round


@pytest.mark.parametrize("late", [0.0, 0.05])
def test_who_walks_by_is_no_wall_where_two_lidars_share_a_topic(late):
    """They shared a tracker: it broke off at scans of one moment, and began anew at each older than the other's."""
    costmap = costmap_of(mark_movers=False)
    for step in range(21):
        now = 10.0 + 0.2 * step
        front, rear = scan(crossing(now - 10.0), now), scan([(-1.0, 0.5, 0.1)], now - late)
        costmap.observe("scan", dataclasses.replace(front, frame="front"), now)
        away = np.s_[BEAMS // 4:-BEAMS // 4]
        costmap.observe("scan", dataclasses.replace(
            rear, frame="rear", points=rear.points[away], hits=rear.hits[away]), now)
        costmap.update(now, Pose2D(0.0, 0.0, 0.0))
    snapshot = costmap.snapshot()
    assert len(snapshot.tracks) == 1
    assert not is_marked(snapshot, 1.0, 0.0, 0.12) and is_marked(snapshot, -1.0, 0.5, 0.1)


def test_nobody_walks_on_whom_only_a_lidar_saw_that_was_replaced():
    costmap = costmap_of()
    for step in range(31):
        now = 10.0 + 0.2 * step
        world = crossing(now - 10.0) if now < 13.0 else []
        costmap.observe("scan", dataclasses.replace(scan(world, now), frame="old" if now < 13.0 else "new"), now)
        costmap.update(now, Pose2D(0.0, 0.0, 0.0))
        if now > 12.0:
            assert len(costmap.snapshot().tracks) == int(now < 13.0)


def looked_through(monkeypatch):
    """Return a list that gets the stamp of each scan that a tracker looks through from now on."""
    stamps, update = [], Tracker.update

    def noted(tracker, x, y, ends, hits, stamp, heading):
        stamps.append(stamp)
        update(tracker, x, y, ends, hits, stamp, heading)

    monkeypatch.setattr(Tracker, "update", noted)
    return stamps


def seen_from(frame, observation):
    x, y, _ = frame
    return dataclasses.replace(observation, origin=(x, y), points=frame.transform_points(observation.points))


def sharing(frame):
    """Return two costmaps; the second, in whose frame that of the first lies at `frame`, plans past who walks."""
    first, second = costmap_of(), costmap_of(mark_movers=False)
    for layer, other in itertools.product(second.layers, first.layers):
        layer.share(other, frame)
    return first, second


def test_who_walks_by_is_looked_for_once_where_two_costmaps_are_always_shown_the_same(monkeypatch):
    frame = Pose2D(0.3, -0.2, 0.7)
    (first, second), alone = sharing(frame), costmap_of(mark_movers=False)
    stamps = looked_through(monkeypatch)
    for step in range(21):
        now = 10.0 + 0.2 * step
        seen = scan(crossing(now - 10.0), now)
        first.observe("scan", seen, now)
        second.observe("scan", seen_from(frame, seen), now)
        assert stamps == [now]
        alone.observe("scan", seen_from(frame, seen), now)
        stamps.clear()
        second.update(now, frame)
        alone.update(now, frame)
    assert np.array_equal(second.snapshot().costs, alone.snapshot().costs)
    (found,), (expected,) = second.snapshot().tracks, alone.snapshot().tracks
    assert np.allclose(found[1:], expected[1:], atol=1e-6) and found.speed > 0.2
    assert abs(first.snapshot().tracks[0].y - found.y) > 0.3, "each tells it in its own frame"


def test_who_walks_by_is_looked_for_by_the_costmap_that_alone_is_shown_him(monkeypatch):
    frame = Pose2D(0.3, -0.2, 0.7)
    _, second = sharing(frame)
    stamps = looked_through(monkeypatch)
    for step in range(21):
        now = 10.0 + 0.2 * step
        second.observe("scan", seen_from(frame, scan(crossing(now - 10.0), now)), now)
    assert len(stamps) == 21 and len(second.snapshot().tracks) == 1


def test_layers_that_look_for_other_things_share_nothing(monkeypatch):
    first, second = costmap_of(track_gap=0.2), costmap_of()
    for layer, other in itertools.product(second.layers, first.layers):
        layer.share(other, Pose2D(0.0, 0.0, 0.0))
    stamps = looked_through(monkeypatch)
    for costmap in (first, second):
        costmap.observe("scan", scan(crossing(0.0), 10.0), 10.0)
    assert stamps == [10.0, 10.0]


def test_a_small_computer_looks_for_nobody_where_the_layer_is_disabled_and_knows_no_old_news_afterwards(monkeypatch):
    costmap = costmap_of()
    watch(costmap, crossing, 4.0)
    assert costmap.snapshot().tracks
    layer = next(layer for layer in costmap.layers if layer.tracks is not None)
    stamps = looked_through(monkeypatch)
    costmap.reconfigure_layer(layer.name, layer.parameters.replace(enabled=False))
    watch(costmap, crossing, 4.0)
    assert stamps == [] and not costmap.snapshot().tracks
    costmap.reconfigure_layer(layer.name, layer.parameters.replace(enabled=True))
    costmap.update(14.0, Pose2D(0.0, 0.0, 0.0))
    assert costmap.snapshot().tracks == ()
    watch(costmap, crossing, 4.0)
    assert len(costmap.snapshot().tracks) == 1


def test_two_whom_two_lidars_see_have_numbers_of_their_own():
    """They were one in `tracks` and in RViz, where each took the other's place."""
    costmap, numbers = costmap_of(), []
    for step in range(21):
        now = 10.0 + 0.2 * step
        for frame, x in (("front", 1.0), ("rear", -1.0)):
            seen = scan([(x, -1.0 + 0.05 * step, 0.12)], now)
            costmap.observe("scan", dataclasses.replace(seen, frame=frame), now)
        costmap.update(now, Pose2D(0.0, 0.0, 0.0))
        numbers.append([track.number for track in costmap.snapshot().tracks])
    assert len(numbers[-1]) == 2 and all(len(set(each)) == len(each) for each in numbers)


def test_who_stops_is_a_wall_again():
    assert is_marked(watch(costmap_of(mark_movers=False), crossing, 10.0), 1.0, 0.5, 0.12)


@pytest.mark.parametrize("parameters", [{"mark_movers": True}, {"mark_movers": False, "enabled": False}])
def test_who_walks_by_is_an_obstacle_where_nobody_asked_for_less(parameters):
    assert is_marked(watch(costmap_of(**parameters), crossing, 4.0), 1.0, 0.0, 0.12)


def test_a_lidar_whose_scans_have_one_stamp_and_not_as_many_readings_is_taken():
    costmap = costmap_of(mark_movers=False)
    for beams in (BEAMS, BEAMS - 7, BEAMS):
        seen = scan([(1.0, 0.0, 0.1)], 10.0)
        costmap.observe("scan", dataclasses.replace(seen, points=seen.points[:beams], hits=seen.hits[:beams]), 10.0)
        costmap.update(10.0, Pose2D(0.0, 0.0, 0.0))
        assert is_marked(costmap.snapshot(), 0.9, 0.0, 0.02)


@pytest.mark.parametrize("is_level", [True, False], ids=["a level lidar", "one whose tilt is known"])
def test_a_lidar_whose_beams_lapse_sees_nobody_where_all_stands_and_wheels_slip(is_level):
    """Real lidars read 0 or nothing every so often; each time all that stands seemed to come as the robot turned."""
    costmap, rng, angles = costmap_of(), np.random.default_rng(2), np.arange(BEAMS) * 2.0 * math.pi / BEAMS
    posts = [(1.0, 0.3, 0.1), (-0.8, 0.9, 0.12), (0.2, -1.1, 0.08), (-1.2, -0.7, 0.15), (1.4, -1.3, 0.1)]
    seen = 0
    for step in range(50):
        told, now = 1.2 * math.sin(0.2 * step), 10.0 + 0.2 * step
        turned = Pose2D(0.0, 0.0, -0.7 * told)  # it turned by less than it was told
        discs = np.column_stack((turned.transform_points(posts), np.array(posts)[:, 2]))
        ranges = np.hypot(*scan(discs, now).points.T)
        lidar = LaserScan(np.where(rng.random(BEAMS) < 0.02, 0.0, ranges), 0.0, angles[1], 0.1, REACH, now)
        pose = Pose2D(0.0, 0.0, told)
        observation = observation_from_scan(lidar, pose)
        if not is_level:
            cos, sin = math.cos(told), math.sin(told)
            rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
            observation = observation_from_points(*scan_points(lidar), rotation, np.array([0.0, 0.0, 0.2]), now)
        costmap.observe("scan", observation, now)
        costmap.update(now, pose)
        seen += len(costmap.snapshot().tracks)
    assert seen == 0


def test_no_wall_stands_where_the_beams_of_a_lidar_end_without_a_hit():
    costmap, seen = costmap_of(mark_movers=False), scan([], 10.0)
    costmap.observe("scan", dataclasses.replace(seen, points=0.5 * seen.points), 10.0)
    costmap.update(10.0, Pose2D(0.0, 0.0, 0.0))
    assert not (costmap.snapshot().costs == LETHAL).any()


def test_who_has_gone_leaves_no_space_kept_free_where_the_window_moved_meanwhile():
    costmap = build_costmap("local_costmap", {
        "global_frame": "odom", "rolling_window": True, "width": 6.0, "height": 6.0, "resolution": 0.05,
        "robot_radius": 0.1, "plugins": [{"name": "people", "type": "mbf_relay::TrackLayer"}],
        "people": {"personal_space": 0.3, "observation_sources": "scan", "scan": {"data_type": "LaserScan"}},
    })
    there = watch(costmap, crossing, 3.0)
    assert len(there.tracks) == 1 and there.costs.any()
    costmap.observe("scan", scan([], 60.0), 60.0)
    costmap.update(60.0, Pose2D(1.0, 0.0, 0.0))
    assert costmap.snapshot().tracks == () and not costmap.snapshot().costs.any()


@pytest.mark.parametrize("seed", range(4))
def test_the_space_kept_free_round_somebody_is_widest_where_he_walks_to_and_hides_no_obstacle(seed):
    rng = np.random.default_rng(seed)
    speed, heading, radius, wide, ahead = rng.uniform((0.2, -3.1, 0.1, 0.2, 0.5), (1.5, 3.1, 0.3, 0.5, 2.5))
    somebody = SimpleNamespace(
        x=2.6, y=2.3, radius=radius, speed=speed, vx=speed * math.cos(heading), vy=speed * math.sin(heading))
    layer = TrackLayer("people", TrackLayerParameters(personal_space=wide, personal_space_ahead=ahead))
    layer.resize(Grid(0.05, 0.0, 0.0, 100, 100))
    layer._around = (somebody,)
    before = rng.choice([0, 90, 252, 253, 254, 255], (100, 100), p=[0.5, 0.3, 0.05, 0.05, 0.05, 0.05]).astype(np.uint8)
    costs, window = before.copy(), Window(20, 15, 70, 90)
    layer.update_costs(costs, window)
    beyond = np.ones_like(costs, bool)
    beyond[window.slices] = False
    assert (costs == before)[beyond].all(), "it is not redone there"
    for row, column in np.argwhere(~beyond):
        x, y = 0.05 * (column + 0.5) - somebody.x, 0.05 * (row + 0.5) - somebody.y
        away, angle = math.hypot(x, y), math.atan2(y, x) - heading
        apart = max(0.0, away - radius)
        spread = wide + ahead * speed / 3.0 if math.cos(angle) > 0.0 else wide
        space = 150.0 * math.exp(
            -0.5 * ((apart * math.cos(angle) / spread) ** 2 + (apart * math.sin(angle) / wide) ** 2))
        was, cost = int(before[row, column]), int(costs[row, column])
        if was >= INSCRIBED:
            assert cost == was
        elif space > 3.0:  # it ends at three standard deviations
            assert abs(cost - max(was, space)) <= 1.0, (row, column)
        else:
            assert was <= cost <= max(was, 3)

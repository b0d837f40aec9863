"""The tracker on made scans: what moves is found with its velocity, and what only seems to move is not."""

import math

import numpy as np
import pytest
from made_scans import scan, scan_of_boxes

from mbf_relay.tracking.clusters import find_clusters, rays_of
from mbf_relay.tracking.parameters import TrackerParameters
from mbf_relay.tracking.track import as_array
from mbf_relay.tracking.tracker import Tracker


def follow(world, seconds=4.0, robot=lambda t: (0.0, 0.0), period=0.2, seed=1):
    """Return the tracker after a while, and how many tracks it had after each scan."""
    tracker, rng, counts = Tracker(TrackerParameters()), np.random.default_rng(seed), []
    for step in range(int(seconds / period)):
        t = step * period
        x, y = robot(t)
        tracker.update(x, y, *scan(x, y, world(t), rng), 10.0 + t)
        counts.append(len(tracker.tracks))
    return tracker, counts


@pytest.mark.parametrize("velocity", [(-0.2, 0.0), (0.0, -0.25), (-0.15, 0.15), (0.0, 0.15)])
def test_a_thing_that_moves_is_found_with_its_velocity_and_size(velocity):
    tracker, _ = follow(lambda t: [(1.0 + (t - 2.0) * velocity[0], 0.5 + (t - 2.0) * velocity[1], 0.12)])
    (track,) = tracker.tracks
    assert (track.vx, track.vy) == pytest.approx(velocity, abs=0.05)
    assert math.hypot(track.x - (1.0 + 1.8 * velocity[0]), track.y - (0.5 + 1.8 * velocity[1])) < 0.06
    assert 0.08 < track.radius < 0.18 and 0.0 < track.velocity_variance < 0.02


def test_what_stands_is_no_track_though_the_robot_passes_and_uncovers_it():
    posts = [
        (0.8, 0.4, 0.05),
        (1.1, 0.5, 0.05),
        (0.9, -0.5, 0.1),
        (1.5, -0.2, 0.06),
        (1.6, 0.6, 0.05),
        (-0.5, 0.9, 0.2),
    ]
    _, counts = follow(lambda t: posts, seconds=8.0, robot=lambda t: (-1.5 + 0.22 * t, 0.05))
    assert max(counts) == 0


@pytest.mark.parametrize("seed", range(40))
def test_a_robot_that_drives_fast_among_boxes_gives_way_to_none_of_them(seed):
    """Beams that had passed along a side of one by a hair told that it had come; robots turned away from their path."""
    rng = np.random.default_rng(seed)
    corners = 0.15 * rng.integers(0, (40, 20), (60, 2)) - (0.0, 1.5)
    corners = corners[np.abs(corners[:, 1] + 0.075) > 0.25]
    boxes, tracker, seen = np.hstack((corners, corners + 0.15)), Tracker(TrackerParameters()), []
    for t in 0.2 * np.arange(32):
        x, y = 0.8 * t - 0.5, 0.05 * math.sin(t)
        tracker.update(x, y, *scan_of_boxes(x, y, boxes, rng), 1.0 + t)
        seen += tracker.tracks
    assert not seen


def test_a_thing_that_stops_is_no_longer_one_that_moves():
    tracker, counts = follow(lambda t: [(1.0, -1.0 + 0.25 * min(t, 4.0), 0.12)], seconds=8.0)
    assert max(counts) == 1 and not tracker.tracks


def test_a_thing_that_stops_half_hidden_stands_too_before_long():
    def world(t):
        return [(0.5, 0.0, 0.15), (0.9, -1.2 + 0.25 * min(t, 3.7), 0.12)]

    tracker, counts = follow(world, seconds=10.0)
    assert max(counts) == 1 and not tracker.tracks


@pytest.mark.parametrize("bearing", [0.0, 0.9, 2.3])
def test_one_that_slows_down_on_its_way_to_the_robot_is_not_lost_sight_of(bearing):
    def world(t):
        away = 1.9 - 0.3 * min(t, 3.0) - 0.13 * max(0.0, t - 3.0)
        return [(away * math.cos(bearing), away * math.sin(bearing), 0.12)]

    _, counts = follow(world, seconds=8.0)
    assert counts[13:] == [1] * len(counts[13:])


@pytest.mark.parametrize("speed, turn", [(0.2, math.pi), (0.3, 1.6), (0.3, math.pi), (0.5, 1.6), (0.5, math.pi)])
@pytest.mark.parametrize("seed", range(3))
def test_who_turns_on_his_way_is_seen_to_come_before_he_is_there(speed, turn, seed):
    """For half a second he was taken to walk on, and a robot that followed him hit him; one in a hurry was lost."""
    def way(t):
        return np.array((0.8, 0.0)) + speed * (
            min(t, 2.0) * np.array((math.cos(1.2), math.sin(1.2))) + max(0.0, t - 2.0) * after)

    after = np.array((math.cos(1.2 + turn), math.sin(1.2 + turn)))
    tracker, _ = follow(lambda t: [(*way(t), 0.12)], seconds=2.6, seed=seed)
    (track,) = tracker.tracks
    assert math.hypot(*((track.vx, track.vy) - speed * after)) < 0.4 * speed


def test_two_that_cross_keep_their_numbers():
    world = lambda t: [(1.2, -0.8 + 0.2 * t, 0.1), (0.7, 0.8 - 0.2 * t, 0.1)]  # noqa: E731
    rng, tracker, numbers = np.random.default_rng(2), Tracker(TrackerParameters()), []
    for step in range(40):
        tracker.update(0.0, 0.0, *scan(0.0, 0.0, world(0.2 * step), rng), 1.0 + 0.2 * step)
        numbers.append({track.number for track in tracker.tracks})
    assert len(set.union(*numbers)) <= 3


def test_one_that_is_gone_is_not_taken_to_have_jumped_to_what_appears_elsewhere():
    tracker, counts = follow(lambda t: [(1.0, -0.5 + 0.25 * t, 0.12)])
    rng = np.random.default_rng(3)
    for step in range(6):
        tracker.update(0.0, 0.0, *scan(0.0, 0.0, [(-1.0, 1.5, 0.12)], rng), 14.0 + 0.2 * step)
        counts.append(len(tracker.tracks))
        assert all(track.speed < 0.4 for track in tracker.tracks)
    assert counts[-7:-4] == [1] * 3 and counts[-1] == 0


@pytest.mark.parametrize("stamp", [3.0, 1000.0], ids=["back", "forward"])
def test_who_was_seen_before_the_clock_was_set_is_seen_anew(stamp):
    tracker, counts = follow(lambda t: [(1.0, -0.5 + 0.25 * t, 0.12)])
    rng, seen = np.random.default_rng(3), []
    for step in range(20):
        tracker.update(0.0, 0.0, *scan(0.0, 0.0, [(1.0, 0.5 - 0.05 * step, 0.12)], rng), stamp + 0.2 * step)
        seen.append(len(tracker.tracks))
    assert counts[-1] == 1 and seen[0] == 0 and seen[-5:] == [1] * 5


def test_who_has_left_is_forgotten():
    tracker, counts = follow(lambda t: [(1.0, -0.5 + 0.25 * t, 0.12)] if t < 4.0 else [], seconds=6.0)
    assert counts[19:23] == [1] * 4 and counts[26:] == [0] * 4, "remembered for track_patience"


@pytest.mark.parametrize("count", [0, 1, 2])
def test_who_was_there_when_a_lidar_went_blind_is_forgotten(count):
    """Of a lidar none of whose beams reads a number, the costmap ended with the first scan a second later."""
    tracker, counts = follow(lambda t: [(1.0, -0.5 + 0.25 * t, 0.12)])
    for step in range(1, 30):
        tracker.update(0.0, 0.0, np.full((count, 2), 1.0), np.ones(count, dtype=bool), 13.8 + 0.2 * step)
        counts.append(len(tracker.tracks))
    assert counts[19:23] == [1] * 4 and counts[26:] == [0] * 23


@pytest.mark.parametrize("seed", range(3))
def test_who_walks_behind_a_pillar_comes_out_the_same(seed):
    tracker, rng, numbers = Tracker(TrackerParameters()), np.random.default_rng(seed), []
    for step in range(45):
        world = [(0.6, 0.0, 0.17), (1.3, -1.1 + 0.05 * step, 0.1)]
        tracker.update(0.0, 0.0, *scan(0.0, 0.0, world, rng), 1.0 + 0.2 * step)
        numbers.append([track.number for track in tracker.tracks])
    assert len(numbers[12]) == 1 and all(each == numbers[12] for each in numbers[12:40]), numbers


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_scans_with_little_in_them_are_no_trouble(count):
    tracker = Tracker(TrackerParameters())
    for stamp in range(1, 10):
        tracker.update(0.0, 0.0, np.full((count, 2), 1.0), np.ones(count, dtype=bool), 0.2 * stamp)
    assert tracker.tracks == ()


def test_a_disc_is_measured_where_it_is():
    ends, hits = scan(0.0, 0.0, [(1.0, 0.3, 0.15)], np.random.default_rng(0))
    (disc,) = find_clusters(rays_of(0.0, 0.0, ends, hits), 0.1, 0.8).discs
    assert disc[:3] == pytest.approx((1.0, 0.3, 0.15), abs=0.04) and disc[3] == 1.0


def test_tracks_go_on_as_they_do():
    tracker, _ = follow(lambda t: [(1.0, -0.5 + 0.25 * t, 0.12)])
    (track,) = tracker.tracks
    later = track.at(track.stamp + 2.0)
    assert later.y == pytest.approx(track.y + 2.0 * track.vy) and later.position_variance > track.position_variance
    assert as_array((track,), track.stamp + 2.0)[0, :2] == pytest.approx((later.x, later.y))


def test_one_who_walks_behind_another_is_remembered_until_he_is_seen_again():
    def world(t):
        return [(0.5, 0.0, 0.15), (0.9, -1.2 + 0.25 * t, 0.06)]  # out of sight for two seconds

    tracker, counts = follow(world, seconds=9.0)
    first = counts.index(1)
    assert set(counts[first:]) == {1}
    (track,) = tracker.tracks
    assert math.hypot(track.x - 0.9, track.y - (-1.2 + 0.25 * 8.8)) < 0.06


@pytest.mark.parametrize("near, far", [(0.7, 0.95), (1.0, 1.1)], ids=["beside", "brushing"])
def test_two_who_pass_close_by_each_other_keep_their_ways(near, far):
    def world(t):
        return [(near, -1.0 + 0.2 * t, 0.1), (far, 1.0 - 0.2 * t, 0.1)]

    tracker, rng = Tracker(TrackerParameters()), np.random.default_rng(3)
    for step in range(40):
        t = 0.2 * step
        tracker.update(0.0, 0.0, *scan(0.0, 0.0, world(t), rng), 10.0 + t)
        if t < 2.0:
            continue
        for track in tracker.tracks:
            first, second = (math.hypot(track.x - x, track.y - y) for x, y, _ in world(t))
            assert track.vy == pytest.approx(0.2 if first < second else -0.2, abs=0.12), f"at {t:.1f} s: {track}"
            assert abs(track.vx) < 0.12, f"at {t:.1f} s: {track}"
    assert len(tracker.tracks) == 2


@pytest.mark.parametrize("seed", range(5))
def test_two_who_walk_side_by_side_are_not_each_as_wide_as_both(seed):
    """Seen as one by a single scan, each was taken to be so wide for as long as the other hid its edge."""
    def world(t):
        return [(0.8 - 0.01 * t, -1.09 + 0.22 * t, 0.12), (0.56 - 0.01 * t, -1.09 + 0.19 * t, 0.1)]

    tracker, rng, found = Tracker(TrackerParameters()), np.random.default_rng(seed), 0
    for step in range(35):
        t = 0.2 * step
        tracker.update(0.0, 0.0, *scan(0.0, 0.0, world(t), rng), 10.0 + t)
        for track in tracker.tracks:
            _, radius = min((math.hypot(track.x - x, track.y - y), radius) for x, y, radius in world(t))
            assert track.radius < radius + 0.06, f"at {t:.1f} s: {track}"
            found += 1
    assert found > 30


@pytest.mark.parametrize("seed", range(5))
def test_what_comes_out_from_behind_a_corner_is_at_once_as_wide_as_is_seen_of_it(seed):
    """A radius that only followed what is seen had half a second's arrears just where little time is left."""
    tracker, rng, radii = Tracker(TrackerParameters()), np.random.default_rng(seed), []
    for step in range(20):
        y = -1.6 + 0.1 * step
        tracker.update(0.0, 0.0, *scan(0.0, 0.0, [(0.7, -0.75, 0.35), (1.6, y, 0.3)], rng), 10.0 + 0.2 * step)
        radii += [track.radius for track in tracker.tracks if track.speed > 0.1]
    assert min(radii[1:]) > 0.23


def test_the_rays_that_end_on_what_moves_are_told():
    tracker, _ = follow(lambda t: [(1.0, -0.6 + 0.25 * t, 0.12), (-1.0, 0.0, 0.12)])
    ends, hits = scan(0.0, 0.0, [(1.0, -0.6 + 0.25 * 4.0, 0.12), (-1.0, 0.0, 0.12)], np.random.default_rng(4))
    tracker.update(0.0, 0.0, ends, hits, 14.0)
    on_it = np.hypot(ends[:, 0] - 1.0, ends[:, 1] - 0.4) < 0.2
    assert (tracker.moving == on_it).all() and on_it.sum() > 5

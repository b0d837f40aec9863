"""What passes to the wheels, and what does not: for any scan, footprint and velocity."""

import dataclasses
import math

import numpy as np
import pytest
from guarded import AHEAD, BEAMS, BURGER, LASER, TEE, guard_that_saw, judged, parameters, scan_of, scan_with
from hypothesis import given, settings
from hypothesis import strategies as st

from mbf_relay.control import velocity_guard as guards
from mbf_relay.control.velocity_guard import VelocityGuard
from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters
from mbf_relay.costmap.outline import OWN_DEPTH, clearances
from mbf_relay.geometry import STOP, Pose2D, Twist2D


def test_a_velocity_with_room_to_brake_passes_unchanged():
    verdict = judged(guard_that_saw(scan_with(1.0, -30, 30)), AHEAD)
    assert verdict == (AHEAD, guards.PASSING, "passing")


def test_a_robot_whose_footprint_is_in_another_unit_is_not_driven_blindly():
    """With centimetres for metres every reading was the robot's own, and everything passed without a word."""
    verdict = judged(guard_that_saw(scan_with(0.2, -40, 41), [[100.0 * x, 100.0 * y] for x, y in BURGER]), AHEAD)
    assert verdict.velocity == STOP and verdict.cause == guards.UNSEEN
    assert verdict.text == "stopped: the footprint reaches 4.10 m to every side, and no lidar sees farther than 3.53 m"


def test_wheels_a_hundred_metres_apart_are_refused_and_do_not_hold_up_the_guard():
    with pytest.raises(ValueError, match="wheel_separation is 160"):
        parameters(wheel_separation=160.0)


def test_a_robot_before_a_wall_is_slowed_and_then_stopped_but_may_back_away():
    shares = []
    for distance in (0.5, 0.15, 0.13, 0.11, 0.095):
        guard = guard_that_saw(scan_with(distance, -40, 41))
        shares.append(judged(guard, AHEAD).velocity.x / AHEAD.x)
        assert judged(guard, Twist2D(-0.22, 0.0, 0.0)).velocity.x == -0.22
    assert shares[0] == 1.0 and 0.0 < shares[1] < 1.0 and shares[-1] == 0.0 and shares == sorted(shares, reverse=True)


def test_a_robot_that_took_up_a_load_keeps_it_off_what_is_ahead():
    guard = guard_that_saw(scan_with(0.5, -40, 41))
    assert judged(guard, AHEAD).velocity == AHEAD
    guard.set_outline(np.array([(10.0 * x if x > 0.0 else x, y) for x, y in BURGER]))
    assert judged(guard, AHEAD).velocity.x < 0.7 * AHEAD.x


def test_a_slowed_arc_is_the_same_arc():
    asked = Twist2D(0.22, 0.0, 0.9)
    slowed = judged(guard_that_saw(scan_with(0.16, -60, 60)), asked).velocity
    assert 0.0 < slowed.x < asked.x and slowed.theta / slowed.x == pytest.approx(asked.theta / asked.x)


@pytest.mark.parametrize("velocity", [Twist2D(math.nan, 0.0, 0.0), Twist2D(0.1, 0.0, math.inf)])
def test_what_is_no_number_becomes_a_stop(velocity):
    verdict = judged(guard_that_saw(scan_with(3.0, 0, 10)), velocity)
    assert verdict.velocity == STOP and verdict.cause == guards.NOT_FINITE


def test_a_sender_that_fell_silent_stops_the_robot():
    guard = guard_that_saw(scan_with(3.0, 0, 10))
    assert judged(guard, AHEAD).velocity == AHEAD
    assert guard.verdict(0.4).velocity == AHEAD
    verdict = guard.verdict(0.51)
    assert verdict.velocity == STOP and verdict.cause == guards.SILENT
    assert judged(guard, AHEAD, 0.55).velocity == AHEAD
    guard.forget_command()
    assert guard.verdict(0.56).cause == guards.SILENT, "whoever sent is known to be gone"


def test_without_a_fresh_scan_nothing_moves_not_even_away():
    guard = VelocityGuard(parameters())
    assert judged(guard, AHEAD).cause == guards.NO_SCAN
    guard.take_scan(scan_with(3.0, 0, 10, stamp=1.0), LASER)
    assert judged(guard, AHEAD, 1.1).velocity == AHEAD
    for now in (1.7, 300.0, 0.3):  # too old, far too old, and from the future
        verdict = judged(guard, Twist2D(-0.1, 0.0, 0.0), now)
        assert verdict.velocity == STOP and verdict.cause == guards.NO_SCAN, now


@pytest.mark.parametrize("velocity", [
    AHEAD, Twist2D(-0.2, 0.0, 0.0), Twist2D(0.0, 0.2, 0.0), Twist2D(0.0, 0.0, 0.5), Twist2D(0.0, 0.0, -0.5)])
def test_a_frozen_lidar_is_no_lidar_while_the_robot_drives(velocity):
    guard = guard_that_saw(scan_with(2.0, 0, 90))
    for tick in range(1, 13):
        guard.take_scan(scan_with(2.0, 0, 90, stamp=0.1 * tick), LASER)
        verdict = judged(guard, velocity, 0.1 * tick)
    assert verdict.velocity == STOP and verdict.cause == guards.NO_SCAN
    judged(guard, STOP, 1.2)
    guard.take_scan(scan_with(2.0, 0, 90, stamp=1.3), LASER)
    assert judged(guard, velocity, 1.3).velocity == velocity, "a robot that stands sees the same twice"


@pytest.mark.parametrize("distance, late", [(math.inf, 0.0), (2.0, 1.0)])
def test_a_lidar_is_not_taken_for_frozen_in_the_open_nor_before_late_wheels_have_moved(distance, late):
    """It would read the same again, and the robot would never have set out."""
    guard = guard_that_saw(scan_with(distance, 0, 90))
    guard.delay.seconds = late
    for tick in range(13):
        guard.take_scan(scan_with(distance, 0, 90, stamp=0.1 * tick), LASER)
        assert judged(guard, AHEAD, 0.1 * tick).velocity == AHEAD, tick


def test_a_lidar_that_reads_nothing_but_errors_lets_nothing_near_pass():
    guard = guard_that_saw(scan_of(np.zeros(BEAMS)))
    for velocity in (AHEAD, Twist2D(-0.2, 0.0, 0.0)):
        assert judged(guard, velocity).velocity.speed() < 1e-6, "what it cannot see may touch it"


def test_dead_beams_ahead_stop_a_robot_and_a_dead_one_here_and_there_does_not():
    ranges = np.full(BEAMS, 2.0)
    ranges[::7] = 0.0
    assert judged(guard_that_saw(scan_of(ranges)), AHEAD).velocity == AHEAD
    ranges[np.arange(-40, 40)] = np.nan
    verdict = judged(guard_that_saw(scan_of(ranges)), AHEAD)
    assert verdict.velocity.x < 1e-6 and verdict.cause == guards.OBSTACLE
    assert judged(guard_that_saw(scan_of(ranges)), Twist2D(-0.2, 0.0, 0.0)).velocity.x == -0.2
    assert judged(guard_that_saw(scan_of(ranges), blind_sector=0.0), AHEAD).velocity == AHEAD


def test_a_robot_whose_mast_hides_a_sector_is_told_why_it_may_not_turn():
    """It was stopped by "something at (-0.10, 0.02) m", where its owner saw nothing, and never told of the lidar."""
    ranges = np.full(BEAMS, 2.0)
    ranges[165:195] = np.nan
    turn = Twist2D(0.0, 0.0, 0.5)
    verdict = judged(guard_that_saw(scan_of(ranges)), turn)
    assert verdict.velocity.theta == 0.0 and "measures nothing" in verdict.text and "blind_sector" in verdict.text
    assert judged(guard_that_saw(scan_of(ranges), blind_sector=0.6), turn).velocity == turn
    text = judged(guard_that_saw(scan_with(0.13, 0, 40)), AHEAD).text
    assert "something at" in text and "measures nothing" not in text


def test_dead_beams_of_a_lidar_inside_of_a_large_robot_stand_for_what_touches_it():
    square = [[-1, -1], [-1, 1], [1, 1], [1, -1]]
    ranges = np.full(BEAMS, 3.0)
    ranges[np.arange(-40, 40)] = 0.0
    assert judged(guard_that_saw(scan_of(ranges), square), AHEAD).velocity.x < 1e-6


def test_one_beam_that_says_too_near_is_enough():
    ranges = np.full(BEAMS, 2.0)
    ranges[0] = -np.inf
    assert judged(guard_that_saw(scan_of(ranges)), AHEAD).velocity.x < 1e-6


def test_a_robot_backs_slowly_where_its_lidar_does_not_look():
    ahead_only = scan_of(np.full(181, 3.0), angle_min=-math.pi / 2, increment=math.pi / 180)
    guard = guard_that_saw(ahead_only)
    verdict = judged(guard, Twist2D(-0.22, 0.0, 0.0))
    assert verdict.velocity.x == pytest.approx(-0.1) and verdict.cause == guards.UNSEEN
    assert judged(guard, AHEAD).velocity == AHEAD
    assert judged(guard, Twist2D(0.0, 0.0, 1.0)).velocity.theta == 1.0


@pytest.mark.parametrize("beside, cause", [(0.14, guards.OBSTACLE), (0.16, guards.UNSEEN)])
def test_a_robot_backs_as_slowly_where_what_its_front_swings_to_would_let_it_go_faster(beside, cause):
    ranges = np.full(181, 3.0)
    ranges[90 + round(math.degrees(math.atan2(beside, 0.55)))] = math.hypot(0.55, beside)
    guard = VelocityGuard(parameters(footprint=[[-0.2, -0.1], [-0.2, 0.1], [0.6, 0.1], [0.6, -0.1]]))
    guard.take_scan(scan_of(ranges, angle_min=-math.pi / 2, increment=math.pi / 180), Pose2D(0.0, 0.0, 0.0))
    verdict = judged(guard, Twist2D(-0.22, 0.0, 0.6))
    assert -0.1 - 1e-9 <= verdict.velocity.x < -0.05 and verdict.cause == cause


@pytest.mark.parametrize("beams", [1, 5])
def test_a_robot_whose_lidar_looks_through_a_keyhole_goes_slowly(beams):
    guard = guard_that_saw(scan_of(np.full(beams, 3.0), angle_min=-0.01 * beams, increment=0.02))
    verdict = judged(guard, AHEAD)
    assert verdict.velocity.x == pytest.approx(0.1) and verdict.cause == guards.UNSEEN


def test_a_robot_drives_no_faster_than_it_can_stop_within_its_lidar_s_range():
    """Of what lay beyond it saw nothing until it was too late to brake."""
    guard = guard_that_saw(scan_of(np.full(BEAMS, np.inf)))
    verdict = judged(guard, Twist2D(4.0, 0.0, 0.0))
    way = 0.2 * verdict.velocity.x + verdict.velocity.x ** 2 / 2.0
    assert verdict.cause == guards.UNSEEN and way == pytest.approx(3.5 - 0.032 - 0.041)
    assert "sees 3.43 m past the footprint" in verdict.text
    assert judged(guard, Twist2D(2.0, 0.0, 0.0)).velocity.x == 2.0


def test_a_robot_does_not_drive_by_a_footprint_that_is_not_round_its_lidar():
    """With base_frame map it was looked at where the map begins; a large robot's, which nobody gave, was 0.46 m."""
    guard = VelocityGuard(parameters(base_frame="map"))
    for x, rides, speed in ((2.0, True, 0.0), (0.6, True, 0.22), (2.0, False, 0.22)):
        guard.take_scan(scan_of(np.full(BEAMS, np.inf)), Pose2D(x, 0.0, 0.0), rides)
        assert judged(guard, AHEAD).velocity.x == speed
    guard.take_scan(scan_of(np.full(BEAMS, np.inf)), Pose2D(-2.0, 0.0, 0.0))
    assert judged(guard, AHEAD).text == (
        "stopped: the lidar in base_scan sits 2.00 m from map, and the footprint reaches 0.15 m from there: one of the "
        "two is not the robot's")


@pytest.mark.parametrize("shorter", [0.005, 3.5])
def test_of_two_lidars_the_one_that_sees_farther_tells_how_fast_a_robot_may_go(shorter):
    guard = VelocityGuard(parameters())
    for frame, range_max in (("near", shorter), ("far", 20.0), ("near", shorter), ("far", 20.0)):
        guard.take_scan(
            dataclasses.replace(scan_of(np.full(BEAMS, np.inf)), frame=frame, range_max=range_max), LASER)
    assert judged(guard, Twist2D(4.0, 0.0, 0.0)).velocity.x == 4.0


@pytest.mark.parametrize("speed", [1.0, 1e200, 1.7e308])
def test_a_robot_whose_lidar_does_not_see_past_its_own_front_goes_slowly(speed):
    """Its range was less than the way to the front, of which the nearest side took no notice."""
    long = [[-1.0, -0.25], [-1.0, 0.25], [1.0, 0.25], [1.0, -0.25]]
    short = dataclasses.replace(scan_of(np.full(BEAMS, np.inf)), range_max=0.9)
    for heading in (0.0, math.pi):
        guard = VelocityGuard(parameters(footprint=long))
        guard.take_scan(short, Pose2D(0.0, 0.0, heading))
        assert judged(guard, Twist2D(speed, 0.0, 0.0)).velocity.x <= 0.1 + 1e-9
        assert judged(guard, Twist2D(0.0, 0.2, 0.0)).velocity.y == 0.2


def test_a_lidar_that_looks_backwards_sees_behind_what_is_before_it():
    guard = VelocityGuard(parameters())
    guard.take_scan(scan_with(0.2, -40, 41), Pose2D(0.0, 0.0, math.pi))
    assert judged(guard, AHEAD).velocity == AHEAD
    assert judged(guard, Twist2D(-0.22, 0.0, 0.0)).velocity.x > -0.22


def half_scan(distance, stamp, frame):
    """Return a scan of half a turn, of a lidar by its frame, that reads one distance (m) all over."""
    return dataclasses.replace(
        scan_of(np.full(181, distance), stamp, angle_min=-math.pi / 2, increment=math.pi / 180), frame=frame)


FRONT, REAR = Pose2D(0.0, 0.0, 0.0), Pose2D(-0.06, 0.0, math.pi)


def test_a_wall_ahead_is_seen_though_the_rear_lidar_spoke_last():
    """Only the newest scan counted, and the rear one, which looks away, let the robot creep on into the wall."""
    guard = VelocityGuard(parameters())
    for stamp in (0.0, 0.2):
        guard.take_scan(half_scan(0.11, stamp, "front"), FRONT)
        guard.take_scan(half_scan(3.0, stamp, "rear"), REAR)
    verdict = judged(guard, AHEAD, 0.2)
    assert verdict.velocity.x < 0.05 and verdict.cause == guards.OBSTACLE
    assert judged(guard, Twist2D(-0.22, 0.0, 0.0), 0.2).velocity.x == -0.22, "the rear one sees that the way is free"


def test_whose_lidar_has_another_computers_clock_is_told_so():
    """The newest scan was -1.9 s old."""
    guard = VelocityGuard(parameters())
    guard.take_scan(half_scan(3.0, 1.9, "front"), FRONT)
    verdict = judged(guard, AHEAD, 0.0)
    assert verdict.velocity == STOP and "1.9 s ahead of the clock" in verdict.text and "clocks" in verdict.text


def test_a_robot_does_not_creep_on_when_the_front_one_of_its_two_lidars_dies():
    guard = VelocityGuard(parameters())
    for tick in range(10):
        if tick < 5:
            guard.take_scan(half_scan(3.0 - 0.1 * tick, 0.2 * tick, "front"), FRONT)
        guard.take_scan(half_scan(2.0 + 0.1 * tick, 0.2 * tick, "rear"), REAR)
        verdict = judged(guard, AHEAD, 0.2 * tick)
        assert (verdict.velocity == AHEAD) == (0 < tick < 7), tick
    assert verdict.velocity == STOP and "in front, one of 2 lidars, is 1.0 s old" in verdict.text
    assert "start this node again" in verdict.text, "and how to go on without it"


def test_what_the_robot_drove_since_the_scan_counts():
    guard = guard_that_saw(scan_with(0.27, -50, 50))
    shares = []
    for tick in range(6):
        judged(guard, AHEAD, 0.1 * tick)  # and what passed twice at one time
        shares.append(judged(guard, AHEAD, 0.1 * tick).velocity.x / AHEAD.x)
    assert shares[0] == 1.0 and shares[-1] < 1.0


def test_a_velocity_beyond_all_measure_is_a_stop():
    verdict = judged(guard_that_saw(scan_of(np.full(BEAMS, np.inf))), Twist2D(1e12, 0.0, 1e9))
    assert verdict.velocity == STOP and "way to a stop is longer than" in verdict.text


def test_a_slim_robot_is_no_faster_than_poses_that_lie_half_its_width_apart_cover_its_way():
    """Between them a pole would have been overlooked."""
    slim = [[-0.5, -0.05], [-0.5, 0.05], [0.5, 0.05], [0.5, -0.05]]
    guard = VelocityGuard(parameters(footprint=slim))
    guard.take_scan(dataclasses.replace(scan_of(np.full(BEAMS, np.inf)), range_max=200.0), LASER)
    speed = judged(guard, Twist2D(10.0, 0.0, 0.0)).velocity.x
    assert 0.2 * speed + 0.5 * speed * speed == pytest.approx(guards.MOST_STEPS * 0.05, rel=0.03)


def test_a_fast_robot_of_a_metre_drives_at_full_speed_where_nothing_is_in_its_way():
    outline = ((-0.6, -0.5), (-0.6, 0.5), (0.6, 0.5), (0.6, -0.5))
    guard = VelocityGuard(VelocityGuardParameters(footprint=outline, acc_lim_x=0.8))
    guard.take_scan(dataclasses.replace(scan_of(np.full(BEAMS, np.inf)), range_max=10.0), LASER)
    assert judged(guard, Twist2D(3.0, 0.0, 0.0)).velocity.x == 3.0


def test_time_set_back_stops_until_all_is_new():
    guard = guard_that_saw(scan_with(3.0, 0, 10, stamp=100.0))
    assert judged(guard, AHEAD, 100.0).velocity == AHEAD
    assert guard.verdict(1.0).velocity == STOP
    guard.take_scan(scan_with(3.1, 0, 10, stamp=1.1), LASER)
    assert judged(guard, AHEAD, 1.1).velocity == AHEAD


OUTLINES = st.sampled_from([BURGER, TEE, [[0.2 * math.cos(a), 0.2 * math.sin(a)] for a in np.arange(16) * math.pi / 8]])
SCANS = st.builds(
    lambda seed, low, high: np.random.default_rng(seed).uniform(low, low + high, BEAMS),
    st.integers(0, 10_000), st.floats(0.1, 0.6), st.floats(0.0, 2.0),
)
VELOCITIES = st.builds(Twist2D, st.floats(-0.5, 0.5), st.just(0.0) | st.floats(-0.3, 0.3), st.floats(-3.0, 3.0))


def way_to_a_stop(velocity, limits, count=60):
    """Return the poses on which a robot reacts and brakes, by small steps."""
    braking = max(velocity.speed() / limits.acc_lim_x, abs(velocity.theta) / limits.acc_lim_theta)
    pose, poses, step = Pose2D(0.0, 0.0, 0.0), [], (limits.reaction_time + braking) / count
    for index in range(count):
        left = limits.reaction_time + braking - (index + 0.5) * step
        share = 1.0 if left >= braking else left / braking
        turn = share * velocity.theta * step
        half = pose.compose(Pose2D(0.0, 0.0, turn / 2.0))
        moved = half.compose(Pose2D(share * velocity.x * step, share * velocity.y * step, turn / 2.0))
        poses.append(moved)
        pose = moved
    return poses


def clearances_on_the_way(velocity, limits, points):
    outline = limits.outline()
    before = clearances(points, outline)
    kept = before > -OWN_DEPTH
    return before[kept], np.array([
        clearances(pose.inverse().transform_points(points[kept]), outline) for pose in way_to_a_stop(velocity, limits)
    ])


@settings(max_examples=40)
@given(OUTLINES, SCANS, VELOCITIES)
def test_what_passes_never_brings_the_footprint_to_a_point_of_the_scan(outline, ranges, velocity):
    guard = guard_that_saw(scan_of(ranges), outline)
    passed = judged(guard, velocity).velocity
    assert passed.speed() <= velocity.speed() + 1e-9 and abs(passed.theta) <= abs(velocity.theta) + 1e-9
    limits = parameters(footprint=outline)
    before, after = clearances_on_the_way(passed, limits, guard._sights[0].points)
    if len(before):
        free = before > limits.margin
        assert (after[:, free] > 0.0).all(), "it touches what it did not"
        assert (after[:, ~free] > before[~free] - 0.003).all(), "it comes nearer to what is near"


@settings(max_examples=40)
@given(OUTLINES, SCANS, VELOCITIES)
def test_a_velocity_away_from_all_that_is_near_always_passes(outline, ranges, velocity):
    guard = guard_that_saw(scan_of(ranges), outline)
    _, after = clearances_on_the_way(velocity, parameters(footprint=outline), guard._sights[0].points)
    before, _ = clearances_on_the_way(STOP, parameters(footprint=outline), guard._sights[0].points)
    if not len(before) or (after >= np.minimum(before, 0.02)).all():
        assert judged(guard, velocity).velocity == velocity


@settings(max_examples=25)
@given(SCANS, st.integers(-1000, 1000))
def test_a_stop_always_passes(ranges, now):
    guard = guard_that_saw(scan_of(ranges, stamp=5.0))
    assert judged(guard, STOP, float(now)).velocity == STOP


@settings(max_examples=60)
@given(
    OUTLINES, SCANS, st.lists(VELOCITIES, min_size=1, max_size=4), st.sampled_from([0.0, 0.16, 0.6]),
    st.floats(0.3, 3.0),
)
def test_what_is_known_to_be_too_far_away_without_a_look_is_so_by_the_footprint(
    outline, ranges, velocities, separation, acceleration
):
    guard, thorough = (
        guard_that_saw(scan_of(ranges), outline, wheel_separation=separation, acc_lim_x=acceleration)
        for _ in range(2)
    )
    thorough._is_clear = lambda *_arguments: False
    for count, velocity in enumerate(velocities):
        now = 0.12 * count
        assert judged(guard, velocity, now) == judged(thorough, velocity, now)


def test_what_is_far_away_takes_no_look_at_the_footprint(monkeypatch):
    guard = guard_that_saw(scan_with(1.0, 0, BEAMS))
    monkeypatch.setattr(guard._braking, "free_share", None)
    assert judged(guard, AHEAD).cause == guards.PASSING

"""A lidar that delivers nothing must not count as seeing nothing in the way."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from mbf_relay.control.blind_beams import blind_points
from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters
from mbf_relay.costmap.observation import scan_points
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.beams import is_hit, limits_of
from mbf_relay.scan import LaserScan
from mbf_relay.scan_monitor import ScanMonitor, gaps

REPOSITORY = Path(__file__).resolve().parents[2]
ANGLES = np.linspace(0.0, 2.0 * math.pi, 360, endpoint=False)
ROOM = 1.5 + 0.5 * np.sin(ANGLES)
CORRIDOR = 0.8 / np.maximum(np.abs(np.sin(ANGLES)), 1e-9)


def scan(ranges, stamp=1.0, angle_min=0.0, width=2.0 * math.pi):
    return LaserScan(np.asarray(ranges, dtype=float), angle_min, width / len(ranges), 0.12, 3.5, stamp)


def changed(beams, value, ranges=ROOM):
    result = ranges.copy()
    result[np.arange(*beams) % len(ranges)] = value
    return scan(result)


def trouble(reading, forward=0.0, monitor=None, pose=IDENTITY):
    return (monitor or ScanMonitor()).trouble(reading, forward, pose)


@pytest.mark.parametrize("value", [0.0, math.nan, -1.0, 0.05, -math.inf])
def test_a_robot_whose_lidar_reads_nothing_anywhere_does_not_drive(value):
    assert "100 %" in trouble(scan(np.full(360, value)))


@pytest.mark.parametrize("beams", [(0, 360), (-12, 12)])
def test_a_robot_whose_lidar_names_no_shortest_range_does_not_take_zeros_for_obstacles_or_for_sight(beams):
    """With the range_min of 0 that many drivers send, a beam that measured nothing had hit the lidar itself."""
    blind = dataclasses.replace(changed(beams, 0.0), range_min=0.0)
    assert "measures nothing" in trouble(blind)
    seen, hits = scan_points(blind)
    assert blind.hit.sum() == len(blind.hit_points) == hits.sum() == len(seen) == np.count_nonzero(blind.ranges)
    assert is_hit(blind.ranges, limits_of(blind)).sum() == len(seen)


@pytest.mark.parametrize("beams", [(0, 25), (-12, 12), (-25, 0), (30, 60), (0, 180), (-180, 0), (40, 200)])
def test_a_robot_that_is_blind_in_a_sector_ahead_does_not_drive(beams):
    assert "ahead" in trouble(changed(beams, 0.0))


def test_the_owner_of_a_depth_camera_is_told_how_to_drive_by_what_is_too_far_away_for_it():
    """Its driver sends NaN there. Goals never came, and nothing told of the parameter that is for it."""
    far = changed((0, 60), math.nan)
    assert "largest_gap: 0.0" in trouble(far) and trouble(far, monitor=ScanMonitor(0.0)) is None


def test_a_turtlebot_in_a_corridor_longer_than_its_lidar_reaches_drives_by_the_file_that_is_for_it():
    """Its driver sends 0 there; the simulated one sends inf."""
    corridor = scan(np.where(CORRIDOR <= 3.5, CORRIDOR, 0.0))
    told = yaml.safe_load((REPOSITORY / "config" / "lds.yaml").read_text())
    gap = {told["move_base_flex"][costmap]["scan"]["largest_gap"] for costmap in ("local_costmap", "global_costmap")}
    assert "ahead" in trouble(corridor) and trouble(corridor, monitor=ScanMonitor(*gap)) is None
    blind = [blind_points(corridor, IDENTITY, sector, np.array([[0.1, 0.1], [0.1, -0.1], [-0.1, -0.1], [-0.1, 0.1]]))
             for sector in (VelocityGuardParameters().blind_sector, told["velocity_guard"]["blind_sector"])]
    assert len(blind[0]) > 0 and len(blind[1]) == 0


def as_an_lds_says(ranges):
    """Return ranges as a TurtleBot3's lidar has them: 0 beyond 3.5 m, and where a beam here and there fails."""
    said = np.where(ranges <= 3.5, ranges, 0.0)
    said[35::40] = 0.0
    return said


@pytest.mark.parametrize("there", [math.inf, 0.0])
def test_a_turtlebot_drives_along_a_corridor_as_under_move_base_though_its_lidar_has_no_word_for_far(there):
    """Its real lidar sends 0 there, and the robot stood in every corridor and hall."""
    corridor = as_an_lds_says(CORRIDOR)
    monitor = ScanMonitor()
    assert (trouble(changed((170, 180), there, ROOM), monitor=monitor) is None) and np.count_nonzero(corridor) > 200
    told = trouble(scan(corridor), monitor=monitor)
    assert told is None if there == 0.0 else "ahead" in told  # whoever sends inf has the word
    assert monitor.takes_gaps_for_far is (told is None)
    assert "ahead" in trouble(scan(np.where(np.abs(ANGLES - math.pi) > 2.7, 0.0, ROOM)))  # something covers it
    assert "100 %" in trouble(scan(np.zeros(360)), monitor=monitor)


@pytest.mark.parametrize("beams", [(0, 20), (30, 40), (100, 260), (70, 120), (-120, -70)])
def test_a_small_gap_and_a_masked_rear_are_driven_with_and_hide_no_larger_one(beams):
    assert trouble(changed(beams, math.nan)) is None
    assert "ahead" in trouble(changed((-40, -15), 0.0, changed(beams, math.nan).ranges))


@pytest.mark.parametrize("forward", [math.pi, 0.5 * math.pi, -0.5 * math.pi])
@pytest.mark.parametrize("upside_down", [False, True])
def test_ahead_is_where_the_robot_goes_not_where_the_lidar_looks(forward, upside_down):
    for looks, blind in ((forward, True), (forward + math.pi, False)):
        middle = round(math.degrees(looks)) * (-1 if upside_down else 1)
        seen = changed((middle - 20, middle + 20), 0.0)
        if upside_down:
            seen = dataclasses.replace(seen, angle_increment=-seen.angle_increment)
        assert "ahead" in trouble(seen, forward) if blind else trouble(seen, forward) is None


def test_a_lidar_with_a_beam_here_and_there_is_none():
    few = np.where(np.arange(360) % 30 == 0, ROOM, 0.0)
    assert "97 %" in trouble(scan(few), monitor=ScanMonitor(1.0))


def test_what_masks_both_ends_of_a_lidar_that_looks_only_ahead_is_no_gap_in_one():
    ends = np.where(np.abs(np.arange(100) - 49.5) < 35.0, 2.0, 0.0)
    assert trouble(scan(ends, angle_min=math.radians(-50.0), width=math.radians(100.0))) is None


def test_a_lidar_that_looks_only_ahead_need_not_see_its_rear():
    assert trouble(scan(ROOM[:180], angle_min=-math.pi / 2.0, width=math.pi)) is None
    half = scan(np.where(np.arange(180) < 90, 0.0, ROOM[:180]), angle_min=-math.pi / 2.0, width=math.pi)
    assert "ahead" in trouble(half)


def test_a_wall_nearer_than_the_lidar_can_read_does_not_make_it_blind():
    with np.errstate(divide="ignore"):
        wall = np.where(np.cos(ANGLES) > 0.1, 0.09 / np.cos(ANGLES), 3.0)
    assert np.count_nonzero(wall < 0.12) > 60
    assert trouble(scan(np.where(wall < 0.12, 0.0, wall))) is None
    ahead = np.where(np.abs(np.arange(180) - 89.5) < 30.0, 0.0, 0.15)  # of a lidar that looks half round
    assert trouble(scan(ahead, angle_min=-math.pi / 2.0, width=math.pi)) is None


@pytest.mark.parametrize("dark", [(0, 60), (120, 180)])
def test_a_robot_whose_lidar_looks_half_round_and_is_blind_at_one_end_does_not_drive_for_a_wall_at_the_other(dark):
    """Its last beam is no neighbour of its first: what both saw near had the dark sector count as something near."""
    ranges = np.full(180, 2.0)
    ranges[[0, 59, 60, 119, 120, 179]] = 0.15
    ranges[slice(*dark)] = 0.0
    assert "60 degrees ahead" in trouble(scan(ranges, angle_min=-math.pi / 2.0, width=math.pi))


@pytest.mark.parametrize("beams", [1, 5, 19])
def test_a_robot_whose_lidar_looks_through_a_keyhole_does_not_drive(beams):
    """One beam that found the way free was driven by, 1.2 m to the goal; a robot is wider than a beam."""
    keyhole = scan(np.full(beams, 2.0), angle_min=-0.5 * math.radians(beams), width=math.radians(beams))
    assert f"{beams} degrees in all" in trouble(keyhole)


def test_a_depth_camera_looks_wide_enough():
    assert trouble(scan(np.full(58, 2.0), angle_min=-0.5, width=1.0)) is None


def test_an_open_place_is_seen_to_be_open():
    monitor = ScanMonitor()
    for x in (0.0, 1.0):  # and to be so farther on
        assert trouble(scan(np.full(360, math.inf)), monitor=monitor, pose=Pose2D(x, 0.0, 0.0)) is None


def test_a_lidar_that_loses_all_walls_at_once_is_not_believed():
    monitor = ScanMonitor()
    assert trouble(scan(ROOM), monitor=monitor) is None
    for _ in range(3):
        assert "nothing at all" in trouble(scan(np.full(360, math.inf)), monitor=monitor)
        assert "nothing at all" in trouble(scan(np.full(360, 3.5)), monitor=monitor)
    assert trouble(scan(ROOM), monitor=monitor) is None


@pytest.mark.parametrize("width", [0.99, 1.2, 1.5])
def test_a_robot_with_a_depth_camera_may_turn_from_a_wall_to_the_open_within_one_picture(width):
    """A TurtleBot 2 looks 57 degrees wide: it stood for good before any open place."""
    monitor, beams = ScanMonitor(), int(57 * width)
    assert trouble(scan(np.full(beams, 2.0), angle_min=-0.5 * width, width=width), monitor=monitor) is None
    assert trouble(scan(np.full(beams, math.inf), angle_min=-0.5 * width, width=width), monitor=monitor) is None


def test_a_lidar_that_looks_half_round_and_loses_all_walls_at_once_is_not_believed():
    monitor = ScanMonitor()
    assert trouble(scan(np.full(180, 2.0), angle_min=-0.5 * math.pi, width=math.pi), monitor=monitor) is None
    assert "sees nothing at all any more" in trouble(
        scan(np.full(180, math.inf), angle_min=-0.5 * math.pi, width=math.pi), monitor=monitor)


def test_a_robot_that_drives_out_into_the_open_drives_on():
    monitor = ScanMonitor()
    for count in (90, 60, 30, 10, 0, 0):
        ranges = np.full(360, math.inf)
        ranges[:count] = 2.0
        assert trouble(scan(ranges), monitor=monitor) is None


@pytest.mark.parametrize("way", [
    Pose2D(0.04, 0.0, 0.0), Pose2D(0.0, -0.04, 0.0), Pose2D(0.0, 0.0, 0.04), Pose2D(0.0, 0.0, -0.04)])
def test_the_same_readings_again_are_old_ones_once_the_robot_has_moved(way):
    walls = np.where(np.arange(360) < 40, math.inf, ROOM)  # but for a door
    monitor = ScanMonitor()
    for share in (0.0, 0.25, 0.5):
        assert trouble(scan(walls), monitor=monitor, pose=Pose2D(*(share * part for part in way))) is None
    assert "same readings" in trouble(scan(walls), monitor=monitor, pose=way)
    assert "same readings" in trouble(scan(walls), monitor=monitor, pose=way), "until it sees again"
    assert trouble(scan(walls + 0.015), monitor=monitor, pose=way) is None


def test_a_standing_robot_may_see_the_same_for_ever():
    monitor = ScanMonitor()
    for _ in range(50):
        assert trouble(scan(ROOM), monitor=monitor) is None


def test_a_lidar_whose_zeros_mean_nothing_is_there_can_be_told_so():
    assert ScanMonitor(0.0).trouble(changed((-40, 40), 0.0), 0.0, IDENTITY) is None


def test_gaps_of_a_full_turn_go_over_its_end():
    usable = np.array([0, 0, 1, 1, 0, 1, 0], dtype=bool)
    assert sorted(gaps(usable, closed=True)) == [(4, 1), (6, 3)]
    assert sorted(gaps(usable, closed=False)) == [(0, 2), (4, 1), (6, 1)]
    assert gaps(np.zeros(4, dtype=bool), closed=True) == [(0, 4)]
    assert gaps(np.ones(4, dtype=bool), closed=True) == []

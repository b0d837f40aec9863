"""What the lidar sees, against exact geometry."""

import math

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")

import trial  # noqa: E402

from mbf_relay.geometry import Pose2D, Twist2D, angle_between  # noqa: E402
from mbf_relay.simulation import Simulation  # noqa: E402
from mbf_relay.simulation.arena import arena  # noqa: E402
from mbf_relay.simulation.faults import Faults  # noqa: E402
from mbf_relay.simulation.frames import Frame  # noqa: E402
from mbf_relay.simulation.parameters import SimulationParameters  # noqa: E402
from mbf_relay.simulation.shapes import Body, Cylinder, Sphere  # noqa: E402


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_ranges_to_a_wall(yaw):
    with trial.simulate([trial.box("wall", 2.0, 0.0, (1.0, 40.0, 1.0))], start=Pose2D(0.0, 0.0, yaw)) as simulation:
        scan = trial.last_scan(simulation)
        true_yaw = simulation.true_pose.theta  # it turns a little when it settles
    directions = scan.angles + true_yaw
    distance = 1.5 - trial.SENSOR_X * math.cos(true_yaw)
    with np.errstate(divide="ignore"):
        expected = np.where(np.cos(directions) > 0.0, distance / np.cos(directions), np.inf)
    hit = expected < 3.45
    assert np.abs(scan.ranges[hit] - expected[hit]).max() < 1e-3
    assert np.isinf(scan.ranges[expected > 3.55]).all()


def test_ranges_inside_a_circle_of_pillars():
    pillars = [
        Body(f"p{i}", Cylinder(0.15, 0.5), Frame.of(1.5 * math.cos(a), 1.5 * math.sin(a), 0.25))
        for i, a in enumerate(np.arange(8) * math.pi / 4.0)
    ]
    with trial.simulate(pillars) as simulation:
        scan = trial.last_scan(simulation)
    expected = np.full(360, np.inf)
    for pillar in pillars:
        to_center = pillar.frame.position[:2] - (trial.SENSOR_X, 0.0)
        along = np.cos(scan.angles) * to_center[0] + np.sin(scan.angles) * to_center[1]
        aside = to_center @ to_center - along ** 2
        hit = (along > 0.0) & (aside < 0.15 ** 2)
        expected[hit] = np.minimum(expected[hit], along[hit] - np.sqrt(0.15 ** 2 - aside[hit]))
        # Beams that graze the round within its roundness may pass; they are no measure of exactness.
        grazing = (along > 0.0) & (np.abs(np.sqrt(np.maximum(aside, 0.0)) - 0.15) < 0.003)
        expected[grazing] = scan.ranges[grazing]
    seen = np.isfinite(expected)
    assert seen.sum() > 80
    assert np.abs(scan.ranges[seen] - expected[seen]).max() < 1e-3
    assert np.isinf(scan.ranges[~seen]).all()


def test_ranges_in_a_corner():
    walls = [trial.box("x", 1.25, 0.0, (0.5, 6.0, 1.0)), trial.box("y", 0.0, 1.75, (6.0, 0.5, 1.0))]
    with trial.simulate(walls) as simulation:
        scan = trial.last_scan(simulation)
    cos, sin = np.cos(scan.angles[1:90]), np.sin(scan.angles[1:90])
    expected = np.minimum((1.0 - trial.SENSOR_X) / cos, 1.5 / sin)
    assert np.abs(scan.ranges[1:90] - expected).max() < 1e-3


def test_the_arena_as_seen_from_its_start():
    with Simulation(arena(), SimulationParameters(**trial.EXACT), 1) as simulation:
        scan = trial.last_scan(simulation)
    # Straight back the ring's side: inner circumradius 2.933, the side's normal at 210 degrees.
    x, y, normal = -2.0 + trial.SENSOR_X, -0.5, math.radians(210.0)
    apothem = 2.933 * math.cos(math.pi / 6.0)
    expected = (apothem - x * math.cos(normal) - y * math.sin(normal)) / math.cos(math.pi - normal)
    assert scan.ranges[180] == pytest.approx(expected, abs=1e-3)


def test_moved_and_added_bodies_are_seen_exactly():
    with trial.simulate([Body("ball", Sphere(0.3), Frame.of(0.0, 2.0, 0.3), mass=0.5)]) as simulation:
        simulation.scene.set_obstacle("a", trial.box("a", 1.0, 0.0, (0.2, 0.2, 0.4)))
        scan = trial.last_scan(simulation)
        assert scan.ranges[0] == pytest.approx(0.9 - trial.SENSOR_X, abs=1e-3)
        simulation.scene.set_obstacle("a", trial.box("a", 2.0, 0.0, (0.2, 0.2, 0.4)))
        assert trial.last_scan(simulation).ranges[0] == pytest.approx(1.9 - trial.SENSOR_X, abs=1e-3)
        simulation.scene.remove_obstacle("a")
        assert math.isinf(trial.last_scan(simulation).ranges[0])
        half_chord = math.sqrt(0.3 ** 2 - (0.3 - 0.182) ** 2)
        expected = min(
            np.linalg.norm([trial.SENSOR_X - half_chord * math.cos(a), 2.0 + half_chord * math.sin(a)])
            for a in np.linspace(0.0, 2.0 * math.pi, 3600)
        )
        assert np.nanmin(scan.ranges[60:120]) == pytest.approx(expected, abs=2e-3)


def test_lidar_limits_and_errors():
    near = trial.box("near", 0.15, 0.0, (0.2, 0.1, 1.0))
    with trial.simulate(
        [trial.box("wall", 2.0, 0.0, (1.0, 1.0, 1.0))], scan_noise=0.02, scan_resolution=0.015
    ) as simulation:
        readings = np.array([o.scan.ranges[0] for o in trial.run(simulation, 40.0) if o.scan is not None])
    assert readings.mean() == pytest.approx(1.5 - trial.SENSOR_X, abs=5e-3)
    assert readings.std() == pytest.approx(math.hypot(0.02, 0.015 / math.sqrt(12.0)), rel=0.25)
    assert np.abs(readings / 0.015 - np.round(readings / 0.015)).max() < 1e-6
    with trial.simulate([], scan_dropout=0.3, scan_range_max=1.0) as simulation:
        simulation.scene.set_obstacle("round", Body("round", Cylinder(0.6, 0.5), Frame.of(2.0, 0.0, 0.25)))
        simulation.scene.set_obstacle("near", near)
        scan = trial.last_scan(simulation)
    assert scan.ranges[0] in (0.0, np.inf)
    assert np.isinf(scan.ranges[90:270]).all()


def test_the_lidar_never_sees_the_robot():
    with trial.simulate(scan_range_min=0.0) as simulation:
        for scan in (o.scan for o in trial.run(simulation, 4.0, Twist2D(0.2, 0.0, 1.0)) if o.scan is not None):
            assert np.isinf(scan.ranges).all()


def test_a_skewed_scan_is_stamped_in_its_middle_and_bent_by_the_motion():
    wall = trial.box("wall", 2.0, 0.0, (1.0, 40.0, 1.0))
    with trial.simulate([wall], scan_skew=True, start=Pose2D(0.0, 0.0, math.pi / 2.0)) as simulation:
        still = [o.scan for o in trial.run(simulation, 0.4) if o.scan is not None][-1]
        assert still.stamp == pytest.approx(simulation.now - 0.1)
        assert still.ranges[270] == pytest.approx(1.5, abs=1e-3)
        trial.run(simulation, 1.0, Twist2D(0.0, 0.0, 1.0))
        heading = simulation.true_pose.theta
        turned = [o.scan for o in trial.run(simulation, 0.2, Twist2D(0.0, 0.0, 1.0)) if o.scan is not None][-1]
    nearest = int(np.argmin(turned.ranges))
    # The beam that looks square to the wall was taken when its share of the turn, at 1 rad/s, was over.
    expected = (-heading - 0.2 * nearest / 360.0) % (2.0 * math.pi)
    assert abs(angle_between(nearest * math.pi / 180.0, expected)) < math.radians(2.0)


@pytest.mark.parametrize("view, beams", [(math.pi, 180), (1.0, 57), (1.5 * math.pi, 270), (1e-3, 1)])
def test_a_lidar_that_looks_into_a_sector_sees_what_one_all_round_sees_there(view, beams):
    wall = trial.box("wall", 2.0, 0.5, (1.0, 4.0, 1.0))
    with trial.simulate([wall], scan_noise=0.0, scan_resolution=0.0, scan_view=view) as simulation:
        sector = trial.last_scan(simulation)
    with trial.simulate([wall], scan_noise=0.0, scan_resolution=0.0, scan_beams=720) as simulation:
        whole = trial.last_scan(simulation)
    assert len(sector.ranges) == beams
    assert sector.angle_min == pytest.approx(-0.5 * math.radians(beams - 1))
    first = round(sector.angle_min / math.radians(0.5))
    np.testing.assert_allclose(sector.ranges, whole.ranges[(first + 2 * np.arange(beams)) % 720], atol=1e-6)


@pytest.mark.parametrize("start, share, dead", [
    (0.5 * math.pi, 0.25, []), (math.pi, 0.25, []), (math.pi, 0.3, range(18)), (-math.pi, 0.3, range(18)),
    (1.25, 0.25, range(161, 180)), (0.0, 0.5, range(90, 180)), (0.0, 1.0, range(180))])
def test_beams_that_die_out_of_view_of_a_sector_kill_none_in_it(start, share, dead):
    """A lidar that looks ahead lost what it saw to the right, as its dead beams were to its left or behind it."""
    walls = [trial.box("wall", 1.0, y, (1.0, 2.0, 1.0)) for y in (-2.0, 0.0, 2.0)]
    with trial.simulate(walls, scan_view=math.pi, scan_range_max=40.0) as simulation:
        simulation.faults = Faults(dead_beams=share, dead_beams_start=start)
        ranges = trial.last_scan(simulation).ranges
    assert np.flatnonzero(ranges == 0.0).tolist() == list(dead)


def test_a_skewed_scan_of_a_sector_is_stamped_in_the_middle_of_that():
    """Half a turn in view is over after half a turn: its middle is three quarters of one old when the turn is over."""
    wall = trial.box("wall", 2.0, 0.0, (1.0, 40.0, 1.0))
    with trial.simulate([wall], scan_skew=True, scan_view=math.pi) as simulation:
        trial.run(simulation, 1.0, Twist2D(0.0, 0.0, 1.0))
        heading = simulation.true_pose.theta
        scan = [o.scan for o in trial.run(simulation, 0.2, Twist2D(0.0, 0.0, 1.0)) if o.scan is not None][-1]
        assert scan.stamp == pytest.approx(simulation.now - 0.15)
    nearest = scan.angle_min + int(np.argmin(scan.ranges)) * scan.angle_increment
    expected = -heading - 0.2 * (nearest - scan.angle_min) / (2.0 * math.pi)
    assert abs(angle_between(nearest, expected)) < math.radians(2.0)


def test_a_scan_begun_before_the_robot_is_set_down_elsewhere_shows_where_it_is_now():
    wall = trial.box("wall", 2.0, 0.0, (1.0, 40.0, 1.0))
    with trial.simulate([wall], scan_skew=True) as simulation:
        trial.run(simulation, 0.5)  # half a turn is under way
        simulation.set_pose(Pose2D(0.0, 0.0, math.pi))
        scan = next(o.scan for o in trial.run(simulation, 0.2) if o.scan is not None)
    assert math.isinf(scan.ranges[0]) and scan.ranges[180] == pytest.approx(1.468, abs=1e-3)  # it sits off the middle

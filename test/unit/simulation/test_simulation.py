"""The simulation: what the lidar sees against exact geometry, how the robot drives, and that one seed gives one run."""

import math
import pickle

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")

from mbf_relay.geometry import Pose2D, Twist2D, angle_between  # noqa: E402
from mbf_relay.simulation import Simulation  # noqa: E402
from mbf_relay.simulation.arena import arena  # noqa: E402
from mbf_relay.simulation.faults import Faults  # noqa: E402
from mbf_relay.simulation.frames import Frame  # noqa: E402
from mbf_relay.simulation.parameters import SimulationParameters  # noqa: E402
from mbf_relay.simulation.shapes import Body, Box, Cylinder, Sphere  # noqa: E402
from mbf_relay.simulation.world import Mover, World  # noqa: E402

EXACT = dict(scan_noise=0.0, scan_resolution=0.0, odom_noise=0.0)
SENSOR_X = -0.032
"""Where the lidar stands in base_footprint (m)."""


def simulate(bodies=(), seed=1, start=Pose2D(0.0, 0.0, 0.0), movers=(), **changes):
    return Simulation(World("test", tuple(bodies), start, tuple(movers)), SimulationParameters(**{**EXACT, **changes}), seed)


def run(simulation, seconds, command=None):
    """Step for some time, a command given anew at 20 Hz, and return everything observed."""
    seen = []
    for step in range(round(seconds * simulation.parameters.physics_rate)):
        if command is not None and step % 6 == 0:
            simulation.set_command(command)
        seen.append(simulation.step())
    return seen


def last_scan(simulation, seconds=0.2):
    return [o.scan for o in run(simulation, seconds) if o.scan is not None][-1]


def box(name, x, y, size, yaw=0.0):
    return Body(name, Box(size), Frame.of(x, y, size[2] / 2.0, yaw=yaw))


@pytest.mark.parametrize("yaw", [0.0, 0.7, -2.0])
def test_ranges_to_a_wall(yaw):
    with simulate([box("wall", 2.0, 0.0, (1.0, 40.0, 1.0))], start=Pose2D(0.0, 0.0, yaw)) as simulation:
        scan = last_scan(simulation)
    directions = scan.angles + yaw
    distance = 1.5 - SENSOR_X * math.cos(yaw)
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
    with simulate(pillars) as simulation:
        scan = last_scan(simulation)
    expected = np.full(360, np.inf)
    for pillar in pillars:
        to_center = pillar.frame.position[:2] - (SENSOR_X, 0.0)
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
    walls = [box("x", 1.25, 0.0, (0.5, 6.0, 1.0)), box("y", 0.0, 1.75, (6.0, 0.5, 1.0))]
    with simulate(walls) as simulation:
        scan = last_scan(simulation)
    cos, sin = np.cos(scan.angles[1:90]), np.sin(scan.angles[1:90])
    expected = np.minimum((1.0 - SENSOR_X) / cos, 1.5 / sin)
    assert np.abs(scan.ranges[1:90] - expected).max() < 1e-3


def test_the_arena_as_seen_from_its_start():
    with Simulation(arena(), SimulationParameters(**EXACT), 1) as simulation:
        scan = last_scan(simulation)
    # Straight back the ring's side: inner circumradius 2.933, the side's normal at 210 degrees.
    x, y, normal = -2.0 + SENSOR_X, -0.5, math.radians(210.0)
    apothem = 2.933 * math.cos(math.pi / 6.0)
    expected = (apothem - x * math.cos(normal) - y * math.sin(normal)) / math.cos(math.pi - normal)
    assert scan.ranges[180] == pytest.approx(expected, abs=1e-3)


def test_moved_and_added_bodies_are_seen_exactly():
    with simulate([Body("ball", Sphere(0.3), Frame.of(0.0, 2.0, 0.3), mass=0.5)]) as simulation:
        simulation.stage.set_obstacle("a", box("a", 1.0, 0.0, (0.2, 0.2, 0.4)))
        scan = last_scan(simulation)
        assert scan.ranges[0] == pytest.approx(0.9 - SENSOR_X, abs=1e-3)
        simulation.stage.set_obstacle("a", box("a", 2.0, 0.0, (0.2, 0.2, 0.4)))
        assert last_scan(simulation).ranges[0] == pytest.approx(1.9 - SENSOR_X, abs=1e-3)
        simulation.stage.remove_obstacle("a")
        assert math.isinf(last_scan(simulation).ranges[0])
        half_chord = math.sqrt(0.3 ** 2 - (0.3 - 0.182) ** 2)
        expected = min(
            np.linalg.norm([SENSOR_X - half_chord * math.cos(a), 2.0 + half_chord * math.sin(a)])
            for a in np.linspace(0.0, 2.0 * math.pi, 3600)
        )
        assert np.nanmin(scan.ranges[60:120]) == pytest.approx(expected, abs=2e-3)


def test_lidar_limits_and_errors():
    near = box("near", 0.15, 0.0, (0.2, 0.1, 1.0))
    with simulate([box("wall", 2.0, 0.0, (1.0, 1.0, 1.0))], scan_noise=0.02, scan_resolution=0.015) as simulation:
        readings = np.array([o.scan.ranges[0] for o in run(simulation, 40.0) if o.scan is not None])
    assert readings.mean() == pytest.approx(1.5 - SENSOR_X, abs=5e-3)
    assert readings.std() == pytest.approx(math.hypot(0.02, 0.015 / math.sqrt(12.0)), rel=0.25)
    assert np.abs(readings / 0.015 - np.round(readings / 0.015)).max() < 1e-6
    with simulate([], scan_dropout=0.3, scan_range_max=1.0) as simulation:
        simulation.stage.set_obstacle("round", Body("round", Cylinder(0.6, 0.5), Frame.of(2.0, 0.0, 0.25)))
        simulation.stage.set_obstacle("near", near)
        scan = last_scan(simulation)
    assert scan.ranges[0] in (0.0, np.inf)
    assert np.isinf(scan.ranges[90:270]).all()


def test_the_lidar_never_sees_the_robot():
    with simulate(scan_range_min=0.0) as simulation:
        for scan in (o.scan for o in run(simulation, 4.0, Twist2D(0.2, 0.0, 1.0)) if o.scan is not None):
            assert np.isinf(scan.ranges).all()


def test_looking_a_little_beyond_the_last_scan_changes_no_reading():
    compared = 0
    with Simulation(arena(), SimulationParameters(**EXACT), 1) as simulation:
        for command in (Twist2D(0.2, 0.0, 0.0), Twist2D(0.0, 0.0, 2.5), Twist2D(0.1, 0.0, -1.0), None):
            if command is None:
                simulation.set_pose(Pose2D(1.5, 0.5, 2.0))
            for step in range(240):
                if command is not None and step % 6 == 0:
                    simulation.set_command(command)
                scan = simulation.step().scan
                if scan is not None:
                    fresh = simulation.lidar._distances(simulation.base.frame(), simulation.lidar._directions)
                    seen = np.isfinite(fresh)
                    assert np.array_equal(np.isfinite(scan.ranges), seen)
                    assert np.abs(scan.ranges[seen] - fresh[seen]).max() < 1e-4
                    compared += 1
    assert compared == 40


def test_a_skewed_scan_is_stamped_in_its_middle_and_bent_by_the_motion():
    wall = box("wall", 2.0, 0.0, (1.0, 40.0, 1.0))
    with simulate([wall], scan_skew=True, start=Pose2D(0.0, 0.0, math.pi / 2.0)) as simulation:
        still = [o.scan for o in run(simulation, 0.4) if o.scan is not None][-1]
        assert still.stamp == pytest.approx(simulation.now - 0.1)
        assert still.ranges[270] == pytest.approx(1.5, abs=1e-3)
        run(simulation, 1.0, Twist2D(0.0, 0.0, 1.0))
        heading = simulation.true_pose.theta
        turned = [o.scan for o in run(simulation, 0.2, Twist2D(0.0, 0.0, 1.0)) if o.scan is not None][-1]
    nearest = int(np.argmin(turned.ranges))
    # The beam that looks square to the wall was taken when its share of the turn, at 1 rad/s, was over.
    expected = (-heading - 0.2 * nearest / 360.0) % (2.0 * math.pi)
    assert abs(angle_between(nearest * math.pi / 180.0, expected)) < math.radians(2.0)


@pytest.mark.parametrize("command", [Twist2D(0.2, 0.0, 0.0), Twist2D(-0.1, 0.0, 0.0)])
def test_drives_straight_at_the_speed_asked_for(command):
    with simulate() as simulation:
        run(simulation, 1.0, command)
        first = simulation.true_pose
        assert simulation.true_velocity.x == pytest.approx(command.x, rel=0.02)
        run(simulation, 5.0, command)
        way = simulation.true_pose.relative_to(first)
    assert way.x == pytest.approx(5.0 * command.x, rel=0.01)
    assert abs(way.y) < 0.01 and abs(way.theta) < 0.01


@pytest.mark.parametrize("turn", [0.5, -2.0])
def test_turns_on_the_spot(turn):
    with simulate() as simulation:
        run(simulation, 1.0, Twist2D(0.0, 0.0, turn))
        assert simulation.true_velocity.theta == pytest.approx(turn, rel=0.02)
        run(simulation, 5.0, Twist2D(0.0, 0.0, turn))
        assert math.hypot(simulation.true_pose.x, simulation.true_pose.y) < 0.005


def test_odometry_follows_the_wheels_and_its_twist_is_the_bodys():
    with simulate(start=Pose2D(1.0, 2.0, math.pi)) as simulation:
        seen = run(simulation, 10.0, Twist2D(0.15, 0.0, 0.4))
        truth = simulation.true_pose.relative_to(Pose2D(1.0, 2.0, math.pi))
    odometry = [o.odometry for o in seen if o.odometry is not None][-1]
    assert odometry.pose.distance_to(truth) < 0.03
    assert abs(angle_between(odometry.pose.theta, truth.theta)) < 0.05
    assert odometry.velocity.x == pytest.approx(0.15, rel=0.02)
    assert odometry.velocity.theta == pytest.approx(0.4, rel=0.02)
    assert (np.diag(odometry.pose_covariance) > 0.0).all()


def test_a_standing_robot_stays_to_the_last_digit():
    with simulate() as simulation:
        run(simulation, 2.0, Twist2D(0.2, 0.0, 1.0))
        run(simulation, 2.0)
        before = simulation.true_pose
        run(simulation, 20.0)
        assert simulation.true_pose == before


def test_accelerates_no_faster_than_allowed():
    with simulate(wheel_acceleration=0.5) as simulation:
        speeds = []
        for _ in range(simulation.parameters.physics_rate):
            simulation.set_command(Twist2D(0.22, 0.0, 0.0))
            simulation.step()
            speeds.append(simulation.true_velocity.x)
    assert speeds[len(speeds) // 5] == pytest.approx(0.1, abs=0.02)
    assert speeds[-1] == pytest.approx(0.22, rel=0.03)


def test_commands_are_limited_and_time_out():
    with simulate() as simulation:
        run(simulation, 1.5, Twist2D(5.0, 0.0, 0.0))
        assert simulation.true_velocity.x == pytest.approx(0.22, rel=0.03)
        run(simulation, 0.4)
        assert simulation.true_velocity.x > 0.1
        run(simulation, 0.6)
        assert abs(simulation.true_velocity.x) < 1e-3
    with simulate(cmd_vel_timeout=0.0) as simulation:
        simulation.set_command(Twist2D(0.1, 0.0, 0.0))
        run(simulation, 3.0)
        assert simulation.true_velocity.x == pytest.approx(0.1, rel=0.03)


@pytest.mark.parametrize("command", [Twist2D(math.nan, 0.0, 0.0), Twist2D(0.1, 0.0, math.inf), Twist2D(0.1, -math.inf, 0.0)])
def test_commands_that_are_not_finite_are_refused(command):
    with simulate() as simulation:
        run(simulation, 1.0, Twist2D(0.1, 0.0, 0.0))
        with pytest.raises(ValueError, match="not finite"):
            simulation.set_command(command)
        simulation.step()
        assert simulation.true_velocity.x == pytest.approx(0.1, rel=0.03)


def stream(seed):
    """Return everything a drive with obstacles, faults and noise gives, and the true path, as bytes."""
    with Simulation(arena(), SimulationParameters(scan_dropout=0.01), seed) as simulation:
        seen = []
        for part, command in enumerate((Twist2D(0.2, 0.0, 0.3), Twist2D(-0.1, 0.0, -1.0), Twist2D(0.22, 0.0, 0.0))):
            if part == 1:
                simulation.stage.set_obstacle("o", box("o", -1.0, 0.6, (0.2, 0.2, 0.4)))
            seen.append((run(simulation, 3.0, command), tuple(simulation.true_pose)))
        return pickle.dumps(seen)


def test_equal_seeds_give_equal_streams_byte_for_byte():
    assert stream(5) == stream(5)
    assert stream(5) != stream(6)


@pytest.mark.parametrize("gap, expected", [(0.094, False), (0.084, True)])
def test_the_robot_is_as_wide_as_its_wheels(gap, expected):
    post = Body("post", Cylinder(0.03, 0.5), Frame.of(0.3, gap + 0.03, 0.25))
    with simulate([post]) as simulation:
        seen = run(simulation, 2.5, Twist2D(0.2, 0.0, 0.0))
        assert any(o.contacts for o in seen) is expected, "wheels reach 0.089 m to the side"


def test_a_touch_is_told_with_its_place_and_the_others_name():
    bodies = [box("wall", 1.0, 0.0, (0.2, 4.0, 1.0)), box("other", -1.0, 0.0, (0.2, 4.0, 1.0))]
    with simulate(bodies) as simulation:
        seen = run(simulation, 8.0, Twist2D(0.2, 0.0, 0.0))
        touches = [contact for o in seen for contact in o.contacts]
        assert touches and {touch.name for touch in touches} == {"wall"}
        assert touches[0].position[0] == pytest.approx(0.9, abs=0.01)
        assert simulation.true_pose.x < 0.9
        # Off the wall again: nothing is wound up in the wheels.
        run(simulation, 2.0, Twist2D(-0.1, 0.0, 0.0))
        assert simulation.true_velocity.x == pytest.approx(-0.1, rel=0.05)
        assert not run(simulation, 0.5)[-1].contacts


def test_loose_bodies_are_pushed_and_named():
    ball = Body("crate", Box((0.2, 0.2, 0.2)), Frame.of(0.5, 0.0, 0.1), mass=0.1)
    with simulate([ball]) as simulation:
        seen = run(simulation, 5.0, Twist2D(0.2, 0.0, 0.0))
        assert "crate" in {contact.name for o in seen for contact in o.contacts}
        crate = [body for body in simulation.stage.bodies() if body.name == "crate"][0]
        assert crate.frame.position[0] > 0.6
        simulation.reset()
        crate = [body for body in simulation.stage.bodies() if body.name == "crate"][0]
        assert crate.frame.position[0] == pytest.approx(0.5)


def test_movers_keep_their_times():
    mover = Mover(Body("cart", Cylinder(0.1, 0.4), Frame.of(0.0, 0.0, 0.2)), [0.0, 2.0, 4.0], [[1, 0, 0], [2, 0, 0], [1, 0, 0]])
    with simulate(movers=[mover]) as simulation:
        for seconds, x in ((1.0, 1.5), (1.0, 2.0), (1.0, 1.5), (1.0, 1.0), (1.0, 1.5)):
            assert last_scan(simulation, seconds).ranges[0] == pytest.approx(x - 0.1 - SENSOR_X, abs=5e-3)
        hit = Mover(Body("ram", Cylinder(0.1, 0.4), Frame.of(0.0, 0.0, 0.2)), [0.0, 4.0], [[1, 0, 0], [0, 0, 0]], loop=False)
    with simulate(movers=[hit]) as simulation:
        assert "ram" in {contact.name for o in run(simulation, 5.0) for contact in o.contacts}


def test_set_down_elsewhere():
    with simulate([box("block", 2.0, 0.0, (1.0, 1.0, 1.0))]) as simulation:
        run(simulation, 1.0, Twist2D(0.2, 0.0, 0.0))
        before = [o.odometry for o in run(simulation, 1.0) if o.odometry is not None][-1]
        simulation.set_pose(Pose2D(0.0, 2.0, 1.0))
        after = [o.odometry for o in run(simulation, 1.0) if o.odometry is not None][-1]
        assert simulation.true_pose.distance_to(Pose2D(0.0, 2.0, 1.0)) < 1e-3
        assert after.pose.distance_to(before.pose) < 2e-3
        for pose, text in ((Pose2D(2.0, 0.1, 0.0), "block"), (Pose2D(math.nan, 0.0, 0.0), "not finite")):
            with pytest.raises(ValueError, match=text):
                simulation.set_pose(pose)
        assert simulation.true_pose.distance_to(Pose2D(0.0, 2.0, 1.0)) < 1e-3


def test_a_start_inside_of_something_is_refused():
    with pytest.raises(ValueError, match=r"start of world 'test'.*'block'"):
        simulate([box("block", 0.0, 0.0, (1.0, 1.0, 1.0))])


def test_reset_brings_everything_back():
    with simulate() as simulation:
        run(simulation, 3.0, Twist2D(0.2, 0.0, 0.5))
        simulation.stage.set_obstacle("o", box("o", 1.0, 0.0, (0.2, 0.2, 0.4)))
        now = simulation.now
        simulation.reset()
        assert simulation.true_pose.distance_to(Pose2D(0.0, 0.0, 0.0)) < 1e-6
        assert simulation.now == now and not simulation.stage.obstacles
        seen = run(simulation, 1.0)
    odometry = [o.odometry for o in seen if o.odometry is not None][-1]
    assert odometry.pose.distance_to(Pose2D(0.0, 0.0, 0.0)) < 1e-3


def test_faults():
    wall = box("wall", 2.0, 0.0, (1.0, 1.0, 1.0))
    with simulate([wall], scan_noise=0.01) as simulation:
        good = last_scan(simulation)
        simulation.faults = Faults(lidar_frozen=True)
        frozen = last_scan(simulation)
        assert np.array_equal(good.ranges, frozen.ranges) and frozen.stamp > good.stamp
        simulation.faults = Faults(lidar_silent=True, odom_silent=True)
        assert not any(o.scan or o.odometry for o in run(simulation, 0.5))
        simulation.faults = Faults(dead_beams=0.5, dead_beams_start=-math.pi / 2.0)
        ranges = last_scan(simulation).ranges
        assert (np.roll(ranges, 90)[:180] == 0.0).all() and (np.roll(ranges, 90)[180:] > 0.0).all()
        simulation.faults = Faults(slip=1.0)
        before = simulation.true_pose
        seen = run(simulation, 3.0, Twist2D(0.2, 0.0, 0.0))
        assert simulation.true_pose.distance_to(before) < 0.01
        odometry = [o.odometry for o in seen if o.odometry is not None]
        assert odometry[-1].pose.distance_to(odometry[0].pose) > 0.4


def test_delayed_commands_come_late_and_in_order():
    with simulate(wheel_acceleration=100.0) as simulation:
        simulation.faults = Faults(command_delay=0.5)
        simulation.set_command(Twist2D(0.2, 0.0, 0.0))
        run(simulation, 0.25)
        simulation.set_command(Twist2D(0.1, 0.0, 0.0))
        run(simulation, 0.2)
        assert abs(simulation.true_velocity.x) < 1e-3
        run(simulation, 0.2)
        assert simulation.true_velocity.x == pytest.approx(0.2, rel=0.05)
        run(simulation, 0.3)
        assert simulation.true_velocity.x == pytest.approx(0.1, rel=0.05)


def test_imu_feels_gravity_turning_and_braking():
    with simulate(gyro_noise=0.0, accelerometer_noise=0.0) as simulation:
        still = [o.imu for o in run(simulation, 0.5) if o.imu is not None][-1]
        assert still.acceleration == pytest.approx([0.0, 0.0, 9.81], abs=0.05)
        speeding = [o.imu for o in run(simulation, 0.15, Twist2D(0.22, 0.0, 0.0)) if o.imu is not None][-1]
        assert speeding.acceleration[0] == pytest.approx(1.0, abs=0.3)
        run(simulation, 1.0, Twist2D(0.0, 0.0, 1.5))
        turning = [o.imu for o in run(simulation, 0.5, Twist2D(0.0, 0.0, 1.5)) if o.imu is not None][-1]
        assert turning.turn_rate[2] == pytest.approx(1.5, rel=0.03)


def test_time_starts_above_zero_and_rates_are_kept():
    with simulate() as simulation:
        assert simulation.now > 0.0
        seen = run(simulation, 2.0)
        assert simulation.now == pytest.approx(simulation.parameters.start_time + 2.0)
    counts = [sum(getattr(o, name) is not None for o in seen) for name in ("scan", "odometry", "imu", "joints")]
    assert counts == [10, 60, 120, 60]
    stamps = [o.odometry.stamp for o in seen if o.odometry is not None]
    assert np.allclose(np.diff(stamps), 1.0 / 30.0)


@pytest.mark.parametrize("changes, text", [
    (dict(odom_rate=50.0), "odom_rate is 50.0 Hz; it must divide physics_rate"),
    (dict(scan_rate=7.0), "scan_rate is 7.0 Hz"),
    (dict(imu_rate=480.0), "imu_rate is 480.0 Hz"),
    (dict(scan_range_max=0.1), "scan_range_max is 0.1"),
    (dict(start_time=0.0), "start_time is 0.0"),
])
def test_rates_that_do_not_divide_and_ranges_out_of_order_are_refused(changes, text):
    with pytest.raises(ValueError, match=text):
        SimulationParameters(**changes)


def test_noise_and_bias_of_the_odometry():
    ends = []
    for seed in range(6):
        with simulate(seed=seed, odom_noise=0.01, scan_rate=0.0, imu_rate=0.0) as simulation:
            seen = run(simulation, 5.0, Twist2D(0.2, 0.0, 0.0))
        ends.append([o.odometry for o in seen if o.odometry is not None][-1].pose)
    assert np.std([end.theta for end in ends]) == pytest.approx(math.sqrt(2.0) * 0.01 / 0.16, rel=0.7)
    with simulate(odom_bias=(0.0, 0.05), scan_rate=0.0, imu_rate=0.0) as simulation:
        seen = run(simulation, 5.0, Twist2D(0.2, 0.0, 0.0))
        assert abs(simulation.true_pose.theta) < 0.01
    assert [o.odometry for o in seen if o.odometry is not None][-1].pose.theta == pytest.approx(0.05 / 0.16, rel=0.1)

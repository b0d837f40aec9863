"""The simulation as a whole: one seed gives one run, its clock and rates, setting down, and faults."""

import math
import pickle

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")

import trial  # noqa: E402

from mbf_relay.geometry import Pose2D, Twist2D  # noqa: E402
from mbf_relay.simulation import Simulation, physics  # noqa: E402
from mbf_relay.simulation.arena import arena  # noqa: E402
from mbf_relay.simulation.faults import Faults  # noqa: E402
from mbf_relay.simulation.parameters import SimulationParameters  # noqa: E402


def stream(seed):
    """Return everything a drive with obstacles, faults and noise gives, and the true path, as bytes."""
    with Simulation(arena(), SimulationParameters(scan_dropout=0.01), seed) as simulation:
        seen = []
        for part, command in enumerate((Twist2D(0.2, 0.0, 0.3), Twist2D(-0.1, 0.0, -1.0), Twist2D(0.22, 0.0, 0.0))):
            if part == 1:
                simulation.scene.set_obstacle("o", trial.box("o", -1.0, 0.6, (0.2, 0.2, 0.4)))
            seen.append((trial.run(simulation, 3.0, command), tuple(simulation.true_pose)))
        return pickle.dumps(seen)


def test_equal_seeds_give_equal_streams_byte_for_byte():
    assert stream(5) == stream(5)
    assert stream(5) != stream(6)


def test_a_world_in_a_client_that_another_one_has_left_is_as_in_a_new_client(monkeypatch):
    """Who drives through one world after the other sees of each what he would see of it alone."""
    left = []
    monkeypatch.setattr(physics, "_left", left)
    alone, used = stream(5), list(left)
    with trial.simulate([trial.box("wall", 0.3, 0.0, (0.1, 9.0, 0.5))], solver_iterations=9, physics_rate=60) as other:
        assert used and not left, "it was to have the client of the first"
        assert any(seen.contacts for seen in trial.run(other, 3.0, Twist2D(0.2, 0.0, -0.1)))
    assert stream(5) == alone and left == used


def test_set_down_elsewhere():
    with trial.simulate([trial.box("block", 2.0, 0.0, (1.0, 1.0, 1.0))]) as simulation:
        trial.run(simulation, 1.0, Twist2D(0.2, 0.0, 0.0))
        before = [o.odometry for o in trial.run(simulation, 1.0) if o.odometry is not None][-1]
        assert simulation.true_pose.x > 0.1
        simulation.set_pose(Pose2D(0.0, 2.0, 1.0))
        assert simulation.true_pose == simulation.base.pose()
        after = [o.odometry for o in trial.run(simulation, 1.0) if o.odometry is not None][-1]
        assert simulation.true_pose.distance_to(Pose2D(0.0, 2.0, 1.0)) < 1e-3
        assert after.pose.distance_to(before.pose) < 2e-3
        for pose, text in ((Pose2D(2.0, 0.1, 0.0), "block"), (Pose2D(math.nan, 0.0, 0.0), "not finite")):
            with pytest.raises(ValueError, match=text):
                simulation.set_pose(pose)
        assert simulation.true_pose.distance_to(Pose2D(0.0, 2.0, 1.0)) < 1e-3


def test_after_a_reset_no_odometry_comes_of_the_drive_before():
    with trial.simulate() as simulation:
        simulation.faults = Faults(odom_delay=0.5)
        trial.run(simulation, 2.0, Twist2D(0.2, 0.0, 0.0))
        simulation.reset()
        told = [o.odometry.pose.x for o in trial.run(simulation, 1.0) if o.odometry is not None]
        assert told and max(map(abs, told)) < 0.01


def test_a_start_inside_of_something_is_refused():
    with pytest.raises(ValueError, match=r"start of world 'test'.*'block'"):
        trial.simulate([trial.box("block", 0.0, 0.0, (1.0, 1.0, 1.0))])


def test_reset_brings_everything_back():
    with trial.simulate() as simulation:
        trial.run(simulation, 3.0, Twist2D(0.2, 0.0, 0.5))
        simulation.scene.set_obstacle("o", trial.box("o", 1.0, 0.0, (0.2, 0.2, 0.4)))
        now = simulation.now
        simulation.reset()
        assert simulation.true_pose.distance_to(Pose2D(0.0, 0.0, 0.0)) < 1e-6
        assert simulation.now == now and not simulation.scene.obstacles
        seen = trial.run(simulation, 1.0)
    odometry = [o.odometry for o in seen if o.odometry is not None][-1]
    assert odometry.pose.distance_to(Pose2D(0.0, 0.0, 0.0)) < 1e-3


def test_faults():
    wall = trial.box("wall", 2.0, 0.0, (1.0, 1.0, 1.0))
    with trial.simulate([wall], scan_noise=0.01) as simulation:
        good = trial.last_scan(simulation)
        simulation.faults = Faults(lidar_frozen=True)
        frozen = trial.last_scan(simulation)
        assert np.array_equal(good.ranges, frozen.ranges) and frozen.stamp > good.stamp
        simulation.faults = Faults(lidar_silent=True, odom_silent=True)
        assert not any(o.scan or o.odometry for o in trial.run(simulation, 0.5))
        simulation.faults = Faults(dead_beams=0.5, dead_beams_start=-math.pi / 2.0)
        ranges = trial.last_scan(simulation).ranges
        assert (np.roll(ranges, 90)[:180] == 0.0).all() and (np.roll(ranges, 90)[180:] > 0.0).all()
        simulation.faults = Faults(slip=1.0)
        before = simulation.true_pose
        seen = trial.run(simulation, 3.0, Twist2D(0.2, 0.0, 0.0))
        assert simulation.true_pose.distance_to(before) < 0.01
        odometry = [o.odometry for o in seen if o.odometry is not None]
        assert odometry[-1].pose.distance_to(odometry[0].pose) > 0.4


def test_time_starts_above_zero_and_rates_are_kept():
    with trial.simulate() as simulation:
        assert simulation.now > 0.0
        seen = trial.run(simulation, 2.0)
        assert simulation.now == pytest.approx(simulation.parameters.start_time + 2.0)
    counts = [sum(getattr(o, name) is not None for o in seen) for name in ("scan", "odometry", "imu", "joints")]
    assert counts == [10, 60, 120, 60]
    stamps = [o.odometry.stamp for o in seen if o.odometry is not None]
    assert np.allclose(np.diff(stamps), 1.0 / 30.0)


def test_a_robot_drives_on_where_the_clock_is_set_elsewhere():
    with trial.simulate() as simulation:
        simulation.faults = Faults(odom_delay=0.5)
        trial.run(simulation, 1.0, Twist2D(0.2, 0.0, 0.0))
        before = simulation.true_pose
        simulation.set_time(300.0)
        seen = trial.run(simulation, 1.0, Twist2D(0.2, 0.0, 0.0))
        assert simulation.now == pytest.approx(301.0)
        assert simulation.true_pose.distance_to(before) == pytest.approx(0.2, abs=0.02)
    stamps = [o.odometry.stamp for o in seen if o.odometry is not None]
    assert 300.0 <= min(stamps) < max(stamps) <= 300.5 + 1e-6
    assert [round(o.scan.stamp - 300.0, 1) for o in seen if o.scan is not None] == [0.2, 0.4, 0.6, 0.8, 1.0]


@pytest.mark.parametrize("changes, text", [
    (dict(odom_rate=50.0), "odom_rate is 50.0 Hz; it must divide physics_rate"),
    (dict(scan_rate=7.0), "scan_rate is 7.0 Hz"),
    (dict(imu_rate=480.0), r"imu_rate is 480.0 Hz; it must divide physics_rate \(120 Hz\), as 120 Hz does$"),
    (dict(imu_rate=100.0), r"imu_rate is 100.0 Hz; it must divide physics_rate \(120 Hz\), as 60 or 120 Hz do$"),
    (dict(scan_range_max=0.1), "scan_range_max is 0.1"),
    (dict(start_time=0.0), "start_time is 0.0"),
])
def test_rates_that_do_not_divide_and_ranges_out_of_order_are_refused(changes, text):
    with pytest.raises(ValueError, match=text):
        SimulationParameters(**changes)

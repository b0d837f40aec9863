"""How the robot drives, and what its wheels and its inertial sensor say of it."""

import math

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")

import trial  # noqa: E402

from mbf_relay.geometry import Pose2D, Twist2D, angle_between  # noqa: E402
from mbf_relay.simulation import Simulation  # noqa: E402
from mbf_relay.simulation.faults import Faults  # noqa: E402
from mbf_relay.simulation.frames import Frame  # noqa: E402
from mbf_relay.simulation.parameters import SimulationParameters  # noqa: E402
from mbf_relay.simulation.robot_file import robot_of  # noqa: E402
from mbf_relay.simulation.world import World  # noqa: E402

BODY = {
    "body": [{"box": [0.3, 0.2, 0.1], "at": [0.0, 0.0, 0.05], "mass": 3.0}],
    "wheels": {"radius": 0.05, "separation": 0.2},
    "casters": [{"at": [0.12, 0.0], "radius": 0.02}, {"at": [-0.12, 0.0], "radius": 0.02}],
}


@pytest.mark.parametrize("command", [Twist2D(0.2, 0.0, 0.0), Twist2D(-0.1, 0.0, 0.0)])
def test_drives_straight_at_the_speed_asked_for(command):
    with trial.simulate() as simulation:
        trial.run(simulation, 1.0, command)
        first = simulation.true_pose
        assert simulation.true_velocity.x == pytest.approx(command.x, rel=0.02)
        trial.run(simulation, 5.0, command)
        way = simulation.true_pose.relative_to(first)
    assert way.x == pytest.approx(5.0 * command.x, rel=0.01)
    assert abs(way.y) < 0.01 and abs(way.theta) < 0.01


@pytest.mark.parametrize("turn", [0.5, -2.0])
def test_turns_on_the_spot(turn):
    with trial.simulate() as simulation:
        trial.run(simulation, 1.0, Twist2D(0.0, 0.0, turn))
        assert simulation.true_velocity.theta == pytest.approx(turn, rel=0.02)
        trial.run(simulation, 5.0, Twist2D(0.0, 0.0, turn))
        assert math.hypot(simulation.true_pose.x, simulation.true_pose.y) < 0.005


def test_ends_where_a_square_sends_it():
    with trial.simulate(scan_rate=0.0, imu_rate=0.0) as simulation:
        for _ in range(4):
            trial.run(simulation, 10.0, Twist2D(0.2, 0.0, 0.0))
            trial.run(simulation, 0.5, Twist2D(0.0, 0.0, 0.0))
            trial.run(simulation, math.pi, Twist2D(0.0, 0.0, 0.5))
            trial.run(simulation, 0.5, Twist2D(0.0, 0.0, 0.0))
        assert simulation.true_pose.distance_to(Pose2D(0.0, 0.0, 0.0)) < 0.003
        assert abs(simulation.true_pose.theta) < math.radians(0.2)


def test_ten_turns_on_the_spot_lose_no_degree():
    with trial.simulate(scan_rate=0.0, imu_rate=0.0) as simulation:
        trial.run(simulation, 20.0 * math.pi, Twist2D(0.0, 0.0, 1.0))
        trial.run(simulation, 1.0, Twist2D(0.0, 0.0, 0.0))
        assert abs(simulation.true_pose.theta) < math.radians(0.5)


def test_odometry_follows_the_wheels_and_its_twist_is_the_bodys():
    with trial.simulate(start=Pose2D(1.0, 2.0, math.pi)) as simulation:
        seen = trial.run(simulation, 10.0, Twist2D(0.15, 0.0, 0.4))
        truth = simulation.true_pose.relative_to(Pose2D(1.0, 2.0, math.pi))
    odometry = [o.odometry for o in seen if o.odometry is not None][-1]
    assert odometry.pose.distance_to(truth) < 0.03
    assert abs(angle_between(odometry.pose.theta, truth.theta)) < 0.05
    assert odometry.velocity.x == pytest.approx(0.15, rel=0.02)
    assert odometry.velocity.theta == pytest.approx(0.4, rel=0.02)
    assert (np.diag(odometry.pose_covariance) > 0.0).all()


def test_noise_and_bias_of_the_odometry():
    ends = []
    for seed in range(6):
        with trial.simulate(seed=seed, odom_noise=0.01, scan_rate=0.0, imu_rate=0.0) as simulation:
            seen = trial.run(simulation, 5.0, Twist2D(0.2, 0.0, 0.0))
        ends.append([o.odometry for o in seen if o.odometry is not None][-1].pose)
    assert np.std([end.theta for end in ends]) == pytest.approx(math.sqrt(2.0) * 0.01 / 0.16, rel=0.7)
    with trial.simulate(odom_bias=(0.0, 0.05), scan_rate=0.0, imu_rate=0.0) as simulation:
        seen = trial.run(simulation, 5.0, Twist2D(0.2, 0.0, 0.0))
        assert abs(simulation.true_pose.theta) < 0.01
    assert [o.odometry for o in seen if o.odometry is not None][-1].pose.theta == pytest.approx(0.05 / 0.16, rel=0.1)


def test_a_standing_robot_stays_to_the_last_digit():
    with trial.simulate() as simulation:
        trial.run(simulation, 2.0, Twist2D(0.2, 0.0, 1.0))
        trial.run(simulation, 2.0)
        before = simulation.true_pose
        trial.run(simulation, 20.0)
        assert simulation.true_pose == before


def test_accelerates_no_faster_than_allowed():
    with trial.simulate(wheel_acceleration=0.5) as simulation:
        speeds = []
        for _ in range(simulation.parameters.physics_rate):
            simulation.set_command(Twist2D(0.22, 0.0, 0.0))
            simulation.step()
            speeds.append(simulation.true_velocity.x)
    assert speeds[len(speeds) // 5] == pytest.approx(0.1, abs=0.02)
    assert speeds[-1] == pytest.approx(0.22, rel=0.03)


def test_commands_are_limited_and_time_out():
    with trial.simulate() as simulation:
        trial.run(simulation, 1.5, Twist2D(5.0, 0.0, 0.0))
        assert simulation.true_velocity.x == pytest.approx(0.22, rel=0.03)
        trial.run(simulation, 0.4)
        assert simulation.true_velocity.x > 0.1
        trial.run(simulation, 0.6)
        assert abs(simulation.true_velocity.x) < 1e-3
    with trial.simulate(cmd_vel_timeout=0.0) as simulation:
        simulation.set_command(Twist2D(0.1, 0.0, 0.0))
        trial.run(simulation, 3.0)
        assert simulation.true_velocity.x == pytest.approx(0.1, rel=0.03)


@pytest.mark.parametrize(
    "command", [Twist2D(math.nan, 0.0, 0.0), Twist2D(0.1, 0.0, math.inf), Twist2D(0.1, -math.inf, 0.0)]
)
def test_commands_that_are_not_finite_are_refused(command):
    with trial.simulate() as simulation:
        trial.run(simulation, 1.0, Twist2D(0.1, 0.0, 0.0))
        with pytest.raises(ValueError, match="not finite"):
            simulation.set_command(command)
        simulation.step()
        assert simulation.true_velocity.x == pytest.approx(0.1, rel=0.03)


def test_delayed_commands_come_late_and_in_order():
    with trial.simulate(wheel_acceleration=100.0) as simulation:
        simulation.faults = Faults(command_delay=0.5)
        simulation.set_command(Twist2D(0.2, 0.0, 0.0))
        trial.run(simulation, 0.25)
        simulation.set_command(Twist2D(0.1, 0.0, 0.0))
        trial.run(simulation, 0.2)
        assert abs(simulation.true_velocity.x) < 1e-3
        trial.run(simulation, 0.2)
        assert simulation.true_velocity.x == pytest.approx(0.2, rel=0.05)
        trial.run(simulation, 0.3)
        assert simulation.true_velocity.x == pytest.approx(0.1, rel=0.05)


def test_imu_feels_gravity_turning_and_braking():
    with trial.simulate(gyro_noise=0.0, accelerometer_noise=0.0) as simulation:
        still = [o.imu for o in trial.run(simulation, 0.5) if o.imu is not None][-1]
        assert still.acceleration == pytest.approx([0.0, 0.0, 9.81], abs=0.05)
        speeding = [o.imu for o in trial.run(simulation, 0.15, Twist2D(0.22, 0.0, 0.0)) if o.imu is not None][-1]
        assert speeding.acceleration[0] == pytest.approx(1.0, abs=0.3)
        trial.run(simulation, 1.0, Twist2D(0.0, 0.0, 1.5))
        turning = [o.imu for o in trial.run(simulation, 0.5, Twist2D(0.0, 0.0, 1.5)) if o.imu is not None][-1]
        assert turning.turn_rate[2] == pytest.approx(1.5, rel=0.03)


def test_an_imu_that_is_mounted_aside_and_turned_measures_there_and_in_its_own_axes():
    """Its frame on /tf was turned and off the axle, and what it read was of base_link."""
    mounted = {**BODY, "imu": {"at": [0.1, 0.0, 0.1], "yaw": math.pi / 2.0}}
    parameters = SimulationParameters(
        robot="burger", gyro_noise=0.0, accelerometer_noise=0.0, wheel_torque=5.0, scan_rate=0.0)
    world = World("test", (), Pose2D(0.0, 0.0, 0.3))
    with Simulation(world, parameters, 1, robot=robot_of("mounted", mounted)) as simulation:
        speeding = [o.imu for o in trial.run(simulation, 0.15, Twist2D(0.22, 0.0, 0.0)) if o.imu is not None][-1]
        assert speeding.acceleration[1] == pytest.approx(-1.0, abs=0.3), "ahead is to its right"
        trial.run(simulation, 1.0, Twist2D(0.0, 0.0, 2.0))
        turning = [o.imu for o in trial.run(simulation, 0.5, Twist2D(0.0, 0.0, 2.0)) if o.imu is not None]
        assert np.mean([reading.acceleration[1] for reading in turning]) == pytest.approx(2.0 ** 2 * 0.1, rel=0.1)
        heading = Frame.from_quaternion((0.0, 0.0, 0.0), turning[-1].orientation).flat().theta
        assert abs(angle_between(heading, simulation.true_pose.theta + math.pi / 2.0)) < 0.05


@pytest.mark.parametrize("rate, speed", [(120, 0.22), (120, 1.0), (60, 0.22)])
def test_wheels_turn_no_faster_than_they_are_told(rate, speed):
    """A burger allowed 1 m/s drove at 1.05, and 12.5 cm farther in three seconds than was commanded."""
    rates = dict(physics_rate=rate, scan_rate=0.0, odom_rate=20.0, imu_rate=0.0, joint_state_rate=0.0)
    with trial.simulate(max_speed=speed, **rates) as simulation:
        trial.run(simulation, 2.0, Twist2D(speed, 0.0, 0.0))
        before, now = simulation.true_pose, simulation.now
        trial.run(simulation, 1.0, Twist2D(speed, 0.0, 0.0))
        driven = before.distance_to(simulation.true_pose) / (simulation.now - now)
    assert driven == pytest.approx(speed, rel=0.003)

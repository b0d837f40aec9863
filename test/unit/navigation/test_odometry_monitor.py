"""Odometry that says that the robot moves and stays where it is."""

import math

import numpy as np
import pytest

from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D
from mbf_relay.navigation.odometry_monitor import OdometryMonitor, TransformMonitor, TwistMonitor

HERE, FORWARD = Pose2D(1.0, 2.0, 0.3), Twist2D(0.2, 0.0, 0.0)


def troubles(readings):
    monitor = OdometryMonitor()
    return [monitor.trouble(0.1 * count, pose, velocity) for count, (pose, velocity) in enumerate(readings)]


@pytest.mark.parametrize("velocity", [
    FORWARD, Twist2D(-0.2, 0.0, 0.0), Twist2D(0.0, -0.2, 0.0), Twist2D(0.0, 0.0, 0.3), Twist2D(0.0, 0.0, -0.3)])
@pytest.mark.parametrize("before", [None, 3600.0])
def test_a_robot_is_not_driven_on_odometry_that_repeats_itself_also_once_time_was_set_back(velocity, before):
    monitor = OdometryMonitor()
    if before is not None:
        assert monitor.trouble(before, HERE, velocity) is None
    found = [monitor.trouble(0.1 * count, HERE, velocity) for count in range(10)]
    assert not any(found[:5]) and all("repeats the same pose" in text for text in found[7:])


@pytest.mark.parametrize("step", [Pose2D(0.02, 0.0, 0.0), Pose2D(0.0, 0.0, 0.02), Pose2D(0.0, 0.0, -0.02)])
@pytest.mark.parametrize("before", [None, 3600.0])
@pytest.mark.parametrize("pose, is_told", [(HERE, True), (IDENTITY, False)])
def test_a_pose_by_tf_that_stays_while_odometry_goes_on_or_turns_is_not_driven_by(step, before, pose, is_told):
    """But for one that was never filled in."""
    monitor = TransformMonitor()
    if before is not None:
        assert monitor.trouble(before, pose, before + 1.0, HERE.compose(Pose2D(-1.0, 0.0, 0.0))) is None
    found = [
        monitor.trouble(0.1 * count, pose, 0.1 * count, HERE.compose(Pose2D(*(count * part for part in step))))
        for count in range(15)]
    assert not any(found[:5]) and ("repeats itself" in found[-1] if is_told else not any(found))


def test_a_robot_that_stops_is_driven_by_tf_although_its_odometry_comes_later():
    """Odometry was still on its way when tf had come to rest: its last steps are no motion that tf does not see."""
    monitor, found = TransformMonitor(), []
    for count in range(40):
        now = 0.05 * count
        pose, told = (HERE.compose(Pose2D(0.5 * min(time, 1.0), 0.0, 0.0)) for time in (now, now - 0.08))
        found.append(monitor.trouble(now, pose, now - 0.08, told))
    assert not any(found)


@pytest.mark.parametrize("readings", [
    [(HERE, STOP)] * 20, [(IDENTITY, FORWARD)] * 20,
    [(HERE._replace(x=1.0 + 1e-9 * count), FORWARD) for count in range(20)],
    [(HERE, FORWARD if count % 5 else STOP) for count in range(20)],
], ids=["it stands", "poses are never filled in", "it creeps", "it jerks"])
def test_a_robot_is_driven_on_odometry_that_does_not_contradict_itself(readings):
    assert not any(troubles(readings))


@pytest.mark.parametrize("told", [
    Pose2D(math.nan, math.nan, 0.0), Pose2D(0.0, 0.0, math.nan), Pose2D(math.nan, math.nan, math.nan)])
def test_a_robot_whose_odometry_tells_velocities_alone_and_no_number_for_a_pose_sets_out(told):
    monitor = TransformMonitor()
    assert not any(monitor.trouble(0.1 * count, HERE, 0.1 * count, told) for count in range(20))


START, CURVE = Pose2D(1.0, 2.0, 2.8), Twist2D(0.4, 0.0, 0.3)


def driven(told, seconds=3.0, velocity=CURVE, rate=20.0, seen=lambda pose, count: pose):
    """Return what is believed of odometry in a curve, and the monitor.

    Args:
        told: Gives the velocity in the message, of the pose.
        seconds, velocity, rate: Of the drive and of its odometry (Hz).
        seen: Gives the pose in the message, of the true one and the reading's number.
    """
    monitor = TwistMonitor()
    poses = [START.compose(velocity.held(count / rate)) for count in range(int(seconds * rate))]
    return [monitor.believed(count / rate, seen(pose, count), told(pose)) for count, pose in enumerate(poses)], monitor


def in_odoms_frame(pose):
    return Twist2D(0.4 * math.cos(pose.theta), 0.4 * math.sin(pose.theta), 0.3)


@pytest.mark.parametrize("told", [
    lambda pose: STOP, in_odoms_frame, lambda pose: Twist2D(-0.4, 0.0, -0.3), lambda pose: Twist2D(0.4, 0.0, 17.2)],
    ids=["zeros", "odometry's frame", "other sign", "degrees"])
@pytest.mark.parametrize("rate", [5.0, 20.0, 200.0])
def test_a_robot_whose_driver_tells_no_velocity_of_the_body_is_driven_by_the_way_it_goes(told, rate):
    """By zeros it was said to stand against commands every 5 s; in odometry's frame it crawled where it headed back."""
    believed, monitor = driven(told, rate=rate)
    assert believed[0] == told(START) and monitor.doubt
    np.testing.assert_allclose(believed[-1], CURVE, atol=2e-3)


def test_what_a_driver_tells_that_was_mended_is_believed_again():
    monitor = driven(lambda pose: STOP)[1]
    for count in range(60, 120):
        monitor.believed(count / 20.0, START.compose(CURVE.held(count / 20.0)), CURVE)
    assert monitor.doubt == "" and monitor.believed(6.0, START, CURVE) == CURVE


def jittering(pose, count):
    return Pose2D(*(np.array(pose) + np.random.default_rng(count).normal(0.0, (0.02, 0.02, 0.01))))


@pytest.mark.parametrize("seen", [
    lambda pose, count: pose, jittering, lambda pose, count: pose if count < 30 else pose._replace(x=pose.x + 0.6),
    lambda pose, count: IDENTITY, lambda pose, count: START, lambda pose, count: Pose2D(math.nan, math.nan, math.nan),
    lambda pose, count: pose._replace(theta=0.0),
], ids=["right", "jitter", "a jump", "no poses", "one pose", "poses of NaN", "no headings"])
def test_a_robot_is_driven_by_the_velocity_that_its_odometry_tells(seen):
    believed, monitor = driven(lambda pose: CURVE, seen=seen)
    assert monitor.doubt == "" and set(believed) == {CURVE}


def test_a_robot_that_stands_and_whose_poses_jitter_stands():
    assert set(driven(lambda pose: STOP, velocity=STOP, seen=jittering, seconds=20.0)[0]) == {STOP}


def test_a_robot_that_drove_while_its_radio_was_silent_is_not_said_to_tell_false_velocities():
    """It stood whenever a reading came, for it was told to drive by each and had stopped before the next."""
    monitor, pose = TwistMonitor(), START
    for count in range(100):
        pose = pose.compose(Pose2D(0.05, 0.0, 0.1))
        assert monitor.believed(0.6 * count, pose, STOP) == STOP
    assert not monitor.doubt


def test_slips_of_half_a_second_are_not_the_fault_of_a_driver_also_where_its_radio_is_silent_between_them():
    monitor = TwistMonitor()
    for begin in (0.0, 10.0):
        for count in range(7):
            pose = START.compose(CURVE.held(0.1 * count))
            assert monitor.believed(begin + 0.1 * count, pose, STOP) == STOP
    assert not monitor.doubt


def test_a_robot_that_drives_does_not_fill_its_memory_with_numpys_masked_arrays(monkeypatch):
    """NumPy's median reads them: a MiB of the server, once a second of the first goal is driven."""
    monkeypatch.delattr(np, "ma")
    _, monitor = driven(lambda pose: CURVE)
    assert not monitor.doubt

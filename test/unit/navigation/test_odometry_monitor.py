"""Odometry that says that the robot moves and stays where it is."""

import math

import pytest

from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D
from mbf_relay.navigation.odometry_monitor import OdometryMonitor, TransformMonitor

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

"""Odometry that says that the robot moves and stays where it is."""

import math

import pytest

from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D
from mbf_relay.navigation.odometry_monitor import OdometryMonitor, TransformMonitor

HERE, FORWARD = Pose2D(1.0, 2.0, 0.3), Twist2D(0.2, 0.0, 0.0)


def troubles(readings):
    monitor = OdometryMonitor()
    return [monitor.trouble(0.1 * count, pose, velocity) for count, (pose, velocity) in enumerate(readings)]


def test_a_robot_is_not_driven_on_odometry_that_repeats_itself():
    found = troubles([(HERE, FORWARD)] * 10)
    assert not any(found[:5]) and all("repeats the same pose" in text for text in found[7:])


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

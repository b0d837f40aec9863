"""A robot whose files name no odometry drives as under move_base; one whose odometry is silent does not."""

from types import SimpleNamespace

import pytest
import rospy
from geometry_msgs.msg import TransformStamped

from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.outcomes import StaleDataError
from mbf_relay.ros.common.odometry import OdometryInput
from mbf_relay.ros.server.robot import RosRobot


@pytest.fixture
def robot(monkeypatch):
    """Return a function that gives a robot whose odometry has so many publishers, and was told a velocity last."""

    def made(publishers, commanded):
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
        monkeypatch.setattr(
            rospy, "Subscriber", lambda *_, **__: SimpleNamespace(get_num_connections=lambda: publishers))
        monkeypatch.setattr(rospy, "get_time", lambda: 10.0)
        return SimpleNamespace(_odometry=OdometryInput("odom"), _odom_timeout=1.0, commanded=commanded)

    return made


@pytest.mark.parametrize("commanded", [None, Twist2D(0.2, 0.0, 0.1)])
def test_a_robot_without_odometry_is_taken_to_drive_as_it_was_told(robot, commanded):
    assert RosRobot.velocity(robot(0, commanded)) == (commanded or STOP)


def test_a_robot_of_which_no_odometry_is_listened_to_is_as_far_as_tf_says_and_as_fast_as_it_was_told(monkeypatch):
    for name in ("Publisher", "Subscriber"):
        monkeypatch.setattr(rospy, name, lambda *_, **__: SimpleNamespace(publish=lambda _message: None))
    monkeypatch.setattr(rospy, "get_time", lambda: 10.0)
    found = TransformStamped()
    found.header.stamp, found.transform.rotation.w = rospy.Time(9.5), 1.0
    robot = RosRobot(SimpleNamespace(lookup_message=lambda *_, **__: found), "base", lambda: 1.0, 1.0)
    robot.listen("")
    assert robot.velocity() == STOP
    robot.command(Twist2D(0.2, 0.0, 0.1))
    assert robot.velocity() == Twist2D(0.2, 0.0, 0.1) and robot.knows_its_motion
    pose = robot.pose_in("odom")
    assert robot.pose_ahead("odom") == 0.0 and robot.caught_up(pose, "odom") == pose


def test_a_robot_whose_odometry_says_nothing_yet_is_not_driven(robot):
    with pytest.raises(StaleDataError, match="no odometry on /odom yet"):
        RosRobot.velocity(robot(1, STOP))

"""A transform that another node keeps alive is no sign that the robot stands."""

import pytest
import rospy
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from ros_testing import as_received

from mbf_relay.outcomes import StaleDataError
from mbf_relay.ros.common.odometry import RawOdometry
from mbf_relay.ros.server.robot import RosRobot


class Broadcast:
    """A robot that drives by odometry of 20 Hz; its transform ends after a second.

    Args:
        goes_on: Whether another one does.
    """

    def __init__(self, monkeypatch, goes_on):
        self.now, self.x, self._goes_on = 10.0, 2.0, goes_on
        self._sent = []
        for name in ("Publisher", "Subscriber"):
            monkeypatch.setattr(rospy, name, lambda *_arguments, **_more: object())
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
        monkeypatch.setattr(rospy, "get_time", lambda: self.now)
        self.robot = RosRobot(self, "base", lambda: 1.0, 1.0)
        self.robot.listen("odom")

    def lookup_message(self, _frame, _base, max_age, named):
        """Return what tf has."""
        told = self.now if self._goes_on else min(self.now, 11.0)
        message = TransformStamped()
        message.header.stamp = rospy.Time.from_sec(told)
        message.transform.translation.x = 0.2 * min(told, 11.0)
        message.transform.rotation.w = 1.0
        assert self.now - told <= max_age
        return message

    def seen(self, seconds, speed=0.2, late=0, asked=True, share=1.0):
        """Return the velocities a controller gets where `asked`.

        Odometry comes with a delay of `late` messages, and its poses tell of a share of the way.
        """
        velocities = []
        for _ in range(round(20 * seconds)):
            self.now += 0.05
            self.x += 0.05 * speed * share
            odometry = Odometry()
            odometry.header.stamp = rospy.Time.from_sec(self.now)
            odometry.pose.pose.position.x, odometry.twist.twist.linear.x = self.x, speed
            self._sent.append(as_received(odometry, RawOdometry))
            self.robot._odometry._take(self._sent[-1 - late:][0])
            if asked:
                self.robot.pose_in("odom")
                velocities.append(self.robot.velocity())
        return velocities


def test_a_robot_is_not_driven_by_a_transform_that_repeats_itself_while_odometry_tells_of_motion(monkeypatch):
    """It drove on for 0.7 m and was said to be stuck; or stood, forgot why, and drove on again."""
    broadcast = Broadcast(monkeypatch, goes_on=True)
    assert len(broadcast.seen(1.5)) == 30
    with pytest.raises(StaleDataError, match="tf repeats itself .*'base' in 'odom' and /odom"):
        broadcast.seen(0.5)
    with pytest.raises(StaleDataError, match="repeats itself"):
        broadcast.seen(2.0, speed=0.0)  # nor does it set out again once it stands


def test_a_robot_is_not_driven_by_odometry_that_repeats_a_pose_and_tells_of_motion(monkeypatch):
    broadcast = Broadcast(monkeypatch, goes_on=False)
    assert len(broadcast.seen(0.3)) == 6
    with pytest.raises(StaleDataError, match="odometry repeats the same pose for .*/odom"):
        broadcast.seen(0.7, share=0.0)


def test_a_robot_whose_transform_comes_late_is_not_taken_for_one_that_contradicts_itself(monkeypatch):
    assert len(Broadcast(monkeypatch, goes_on=False).seen(1.9)) == 38


@pytest.mark.parametrize("speed, late", [(1.0, 1), (0.2, 4)])
@pytest.mark.parametrize("pause", [0.0, 5.0], ids=["it is watched", "nobody looks for a while"])
def test_a_robot_that_stopped_as_odometry_came_late_may_set_out_again(monkeypatch, speed, late, pause):
    """It stood for good: where odometry was before the last bit of its way was held against where it is since."""
    broadcast = Broadcast(monkeypatch, goes_on=True)
    broadcast.seen(0.75, speed)
    assert len(broadcast.seen(0.25, speed, late)) == 5
    broadcast.seen(pause, 0.0, late, asked=False)
    assert len(broadcast.seen(2.0, 0.0, late)) == 40


@pytest.mark.parametrize("late", [0, 1, 4])
def test_a_robot_knows_by_how_much_its_transform_and_its_odometry_tell_of_different_times(monkeypatch, late):
    broadcast = Broadcast(monkeypatch, goes_on=True)
    broadcast.seen(0.8, late=late)
    assert broadcast.robot.pose_ahead("odom") == pytest.approx(0.05 * late)
    assert broadcast.robot.pose_ahead("map") == 0.0  # where nobody asked for a pose yet


def test_a_robot_knows_that_its_transform_is_of_the_time_when_it_ended(monkeypatch):
    broadcast = Broadcast(monkeypatch, goes_on=False)
    broadcast.seen(1.4)
    assert broadcast.robot.pose_ahead("odom") == pytest.approx(-0.4)

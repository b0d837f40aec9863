"""Clicked poses on their way to the relay, as goals of the node's own action."""

import pytest
import rospy
from geometry_msgs.msg import PoseStamped

from mbf_relay.ros.relay import node


class PaperTopic:
    """A publisher by rospy's rules: what goes out before somebody is connected is lost."""

    def __init__(self, *_arguments, **_options):
        self.listeners, self.heard, self.impl = [], [], self

    def has_connection(self, listener):
        return listener in self.listeners

    def publish(self, message):
        self.heard += [(listener, message) for listener in self.listeners]


def latched(pose):
    """Return a Subscriber to which a pose comes as soon as it is made."""
    return lambda topic, kind, callback, **_options: callback(pose)


@pytest.mark.parametrize("through_action", [True, False])
def test_a_latched_pose_becomes_a_goal_however_early_it_is_there(monkeypatch, through_action):
    """It was published to nobody where the node did not hear itself yet: the robot stood, and nobody was told why."""
    pose, pursued = PoseStamped(), []
    relay = type("Relay", (), {"take_goal": lambda self, goal, now: pursued.append(goal)})()
    for name, stand_in in {"Publisher": PaperTopic, "Subscriber": latched(pose), "get_name": lambda: "/move_base",
                           "get_rostime": lambda: rospy.Time(1), "get_time": lambda: 0.0}.items():
        monkeypatch.setattr(f"rospy.{name}", stand_in)
    poses = node.SimpleGoals(relay, through_action)
    poses.check()
    if through_action:
        goals = poses._goals
        goals.listeners.append("/rostopic")  # whoever else listens carries nothing out
        poses.check()
        goals.listeners.append("/move_base")
        poses.check()
        pursued = [message.goal.target_pose for listener, message in goals.heard if listener == "/move_base"]
        assert pursued == [pose]
    else:
        assert len(pursued) == 1


def test_a_clicked_pose_drives_a_robot_whose_action_is_remapped(monkeypatch):
    """The node waited to hear itself on move_base/goal, where its action was not: clicks were lost without a word."""
    made = {}

    def make(topic, *_arguments, **_options):
        return made.setdefault(topic, PaperTopic())

    for name, stand_in in {"Publisher": make, "Subscriber": make, "get_name": lambda: "/move_base_node"}.items():
        monkeypatch.setattr(f"rospy.{name}", stand_in)
    for name, other in {"/move_base": "/robot/navigate", "/move_base_simple": "/rviz"}.items():
        monkeypatch.setitem(rospy.names.get_resolved_mappings(), name, other)
    poses = node.SimpleGoals(None, through_action=True)
    made["/robot/navigate/goal"].listeners.append("/move_base_node")
    poses.check()
    assert "/rviz/goal" in made

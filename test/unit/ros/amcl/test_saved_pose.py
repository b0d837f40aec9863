"""The pose that a restarted amcl begins at goes on being saved, whatever the master once answered."""

import threading
import xmlrpc.client

import numpy as np
import pytest
import rospy
from ros_testing import wait_until

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.kept_pose import KeptPose
from mbf_relay.ros.amcl.saved_pose import SavedPose


@pytest.mark.parametrize("answer", [
    xmlrpc.client.Fault(1, "dictionary changed size during iteration"),
    xmlrpc.client.ProtocolError("http://localhost:11311", 503, "busy", {}), ConnectionRefusedError()])
def test_a_robot_is_found_again_where_it_was_last_though_the_master_once_could_not_say(monkeypatch, answer):
    answers, kept = [answer], {}

    def set_param(name, value):
        if answers:
            raise answers.pop()
        kept[name] = value

    monkeypatch.setattr(rospy, "set_param", set_param)
    saved = SavedPose()
    for x in (1.0, 2.0):
        saved.save_soon(KeptPose(Pose2D(x, 0.0, 0.0), IDENTITY, 5.0), np.eye(3))
        wait_until(lambda: not answers, "a first try to save")
    wait_until(lambda: kept.get("~initial_pose_x") == 2.0 and "~saved_odom" in kept, "the newest pose to be saved", 5.0)


def test_a_master_that_hung_is_told_the_newest_pose_and_none_that_came_before(monkeypatch):
    """Each that had come meanwhile was kept, over a night thousands, and written one by one afterwards."""
    asked, answers, told = threading.Event(), threading.Event(), []

    def set_param(name, value):
        asked.set()
        answers.wait()
        if name == "~initial_pose_x":
            told.append(value)

    monkeypatch.setattr(rospy, "set_param", set_param)
    saved = SavedPose()
    for x in range(100):
        saved.save_soon(KeptPose(Pose2D(x, 0.0, 0.0), IDENTITY, 5.0), np.eye(3))
        asked.wait()
    answers.set()
    wait_until(lambda: told and told[-1] == 99.0, "the newest pose to be saved", 5.0)
    assert told == [0.0, 99.0]


def test_a_pose_goes_on_being_saved_after_time_was_set_back_and_no_more_often_than_asked_for():
    saved = SavedPose()
    assert [saved.take_turn(now, 0.5) for now in (10.0, 11.9, 12.0, 3.0, 4.0)] == [True, False, True, True, False]
    assert not saved.take_turn(100.0, 0.0)

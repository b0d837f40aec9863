"""Odometry is listened to where the robot's files name it: for the server, or for one of its controllers."""

from types import SimpleNamespace

import pytest

from mbf_relay.navigation.navigator import Navigator

TEB, DWA = "teb_local_planner/TebLocalPlannerROS", "dwa_local_planner/DWAPlannerROS"
OTHER = {"name": "pursuit", "type": "regulated_pure_pursuit"}


def topic_of(type_name, group, **server):
    config = {"controllers": [OTHER, {"name": "drive", "type": type_name}], "drive": group, **server}
    return Navigator(config, SimpleNamespace(), {}).odom_topic


@pytest.mark.parametrize("type_name", [TEB, DWA])
def test_no_robot_is_driven_by_its_last_command_whose_controller_s_file_names_its_odometry(type_name):
    assert topic_of(type_name, {"odom_topic": "odometry/filtered"}) == "odometry/filtered"
    assert topic_of(type_name, {}) == "odom"


@pytest.mark.parametrize("named", ["odom", "base/odom", ""])
def test_the_server_s_own_topic_goes_before_a_controller_s(named):
    assert topic_of(TEB, {"odom_topic": "odometry/filtered"}, odom_topic=named) == named

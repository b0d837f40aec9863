"""A log line waits for nobody."""

import pytest

rospy = pytest.importorskip("rospy")

from mbf_relay.ros.common import node  # noqa: E402


def test_a_robot_whose_node_logs_a_line_does_not_wait_for_a_master_that_hangs(monkeypatch):
    import rospy.impl.paramserver

    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")  # where nobody is
    monkeypatch.setattr(rospy, "get_param", lambda _name, default: default)
    monkeypatch.setattr(rospy.client, "_param_server", None)
    monkeypatch.setattr(rospy.impl.paramserver, "_param_server_cache", None)
    with pytest.raises((OSError, TypeError)):
        rospy.get_param_cached(node.TOPICS_IN_LOGS_DISABLED)  # as rospy does for each line
    node.log_without_master()
    assert rospy.get_param_cached(node.TOPICS_IN_LOGS_DISABLED) is False

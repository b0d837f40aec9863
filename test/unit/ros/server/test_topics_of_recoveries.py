"""Where clients hear of the recoveries that begin."""

import types

import pytest
import rospy

from mbf_relay.ros.server.topics import NavigationTopics


@pytest.mark.parametrize("is_move_base, topic", [
    (False, "/move_base_node/recovery_status"), (True, "/move_base/recovery_status"),
], ids=["server", "move_base"])
def test_a_node_move_base_of_another_name_tells_of_recoveries_beside_its_action(monkeypatch, is_move_base, topic):
    """Clients listen to move_base/recovery_status, where C++'s node tells of them whatever it is called."""
    heard = {}
    monkeypatch.setattr("rospy.names.get_name", lambda: "/move_base_node")
    monkeypatch.setattr("rospy.Publisher", lambda name, *_arguments, **_options: types.SimpleNamespace(
        publish=lambda message: heard.setdefault(rospy.resolve_name(name), message)))
    navigator = types.SimpleNamespace()
    NavigationTopics(navigator, is_move_base)
    navigator.recovery_watcher("rotate_recovery", 1, 4, None, "no plan")
    assert list(heard) == [topic] and heard[topic].recovery_behavior_name == "rotate_recovery"

"""No message is lost between two connections with the same publisher."""

import threading

import pytest

pytest.importorskip("rospy", reason="needs ROS")

from mbf_relay.ros.common.rospy_patches import connecting  # noqa: E402


def test_a_goal_sent_on_the_first_connection_is_not_lost_to_a_second(monkeypatch):
    connected, made = set(), []
    both = threading.Barrier(2)

    def as_rospy(_handler, topic, publisher):
        if (topic, publisher) not in connected:
            try:
                both.wait(0.3)  # where two are at it, both have looked
            except threading.BrokenBarrierError:
                pass
            connected.add((topic, publisher))
            made.append((topic, publisher))
        return 1, "connected", 0

    monkeypatch.setattr(connecting, "_connect_as_rospy", as_rospy)
    threads = [threading.Thread(target=connecting.connect_topic, args=(None, "/goal", "client")) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert made == [("/goal", "client")] and not connecting._locks


def test_a_publisher_that_does_not_answer_keeps_no_other_waiting(monkeypatch):
    dead, heard = threading.Event(), threading.Event()

    def as_rospy(_handler, _topic, publisher):
        if publisher == "dead":
            dead.wait(10.0)
        else:
            heard.set()

    monkeypatch.setattr(connecting, "_connect_as_rospy", as_rospy)
    waiting = threading.Thread(target=connecting.connect_topic, args=(None, "/goal", "dead"))
    waiting.start()
    try:
        connecting.connect_topic(None, "/goal", "client")
        assert heard.is_set()
    finally:
        dead.set()
        waiting.join()

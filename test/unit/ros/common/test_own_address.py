"""A node that tells others an address where it is not says so, instead of being ready for nothing."""

from types import SimpleNamespace

import pytest

from mbf_relay.ros.common import own_address


@pytest.fixture
def told(monkeypatch):
    """Return what is warned of, and a function that has a node look at an address."""
    warnings = []
    monkeypatch.setattr(own_address.rospy, "logwarn", lambda text, *values: warnings.append(text % values))
    monkeypatch.setattr(own_address.rospy, "get_name", lambda: "/node")
    monkeypatch.setattr(own_address.threading, "Thread", lambda target, args, **_: SimpleNamespace(
        start=lambda: target(*args)))
    asked = []

    def start(address, get_pid):
        monkeypatch.setattr(own_address.rospy, "get_node_uri", lambda: address)
        monkeypatch.setattr(own_address, "impatient_proxy", lambda at, _: asked.append(at) or SimpleNamespace(
            getPid=get_pid))
        own_address.warn_where_unreachable()
        return asked, warnings

    return start


def refuse(_name):
    raise OSError("Name or service not known")


def test_a_node_by_a_name_that_leads_nowhere_says_so(told):
    _, warnings = told("http://nowhere.invalid:1234/", refuse)
    assert len(warnings) == 1 and "http://nowhere.invalid:1234/" in warnings[0] and "ROS_HOSTNAME" in warnings[0]
    assert "Name or service not known" in warnings[0]


def test_a_node_by_a_name_that_is_none_says_so(monkeypatch):
    """The look at it ended in a traceback, and nothing said what to mend."""
    warnings = []
    monkeypatch.setattr(own_address.rospy, "logwarn", lambda text, *values: warnings.append(text % values))
    own_address.check("http://robot..local:1234/")
    assert len(warnings) == 1 and "http://robot..local:1234/" in warnings[0] and "ROS_HOSTNAME" in warnings[0]


def test_a_node_that_reaches_itself_says_nothing(told):
    assert told("http://robot:1234/", lambda name: (1, "pid", 5)) == (["http://robot:1234/"], [])


@pytest.mark.parametrize("address", ["http://127.0.0.1:1234/", "http://localhost:1/", "http://[::1]:1/", None])
def test_a_node_on_this_machine_alone_does_not_ask(told, address):
    assert told(address, refuse) == ([], [])

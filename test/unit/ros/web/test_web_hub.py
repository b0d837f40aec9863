"""Which robot a page shows, whatever it is called and whenever it is found."""

import asyncio
from types import SimpleNamespace

import pytest

pytest.importorskip("tornado")

from ros_testing import wait_until  # noqa: E402

from mbf_relay.geometry import Twist2D  # noqa: E402
from mbf_relay.ros.web import hub as hub_module  # noqa: E402
from mbf_relay.view import dead_man  # noqa: E402
from mbf_relay.view.feed import Feed  # noqa: E402
from mbf_relay.view.parameters import WebViewParameters  # noqa: E402
from mbf_relay.view.rights import Rights  # noqa: E402


class PaperBrowser:
    """A connection that has been welcomed, and keeps what it was told."""

    number = 1

    def __init__(self):
        self.feed, self.rights, self.robot, self.shown = Feed(), Rights(True, True), None, []

    def welcome(self, is_guess):
        """Take note of the robot."""
        self.shown.append((self.robot.namespace, is_guess))

    def say(self, *_, **__):
        """Hear nothing."""

    def send_due(self, *_):
        """Take nothing."""


class NoGraph:
    """Stands for the thread that talks to the master, and does nothing."""

    def submit(self, _work):
        """Do nothing."""


@pytest.fixture
def hub(tmp_path, monkeypatch):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    monkeypatch.setattr(hub_module, "ThreadPoolExecutor", lambda *_, **__: NoGraph())
    loop = asyncio.new_event_loop()
    yield hub_module.Hub(WebViewParameters(), loop)
    loop.close()


def meet(hub, name=""):
    """Return a browser that has asked for a robot by its name, or for any."""
    browser = PaperBrowser()
    hub.browsers.append(browser)
    hub.join(browser, name)
    return browser


def look(hub, *namespaces):
    """Have the hub find robots."""
    hub._looked({f"{namespace}odom": "nav_msgs/Odometry" for namespace in namespaces})


def test_the_first_page_shows_a_robot_in_a_namespace_once_it_is_found(hub):
    browser = meet(hub)
    look(hub)
    look(hub, "/burger1/", "/burger2/")
    look(hub, "/burger1/", "/burger2/")
    assert browser.shown == [("/", True), ("/burger1/", False)]


def test_a_page_keeps_its_robot_though_the_node_was_started_anew_and_knows_none_yet(hub):
    browser = meet(hub, "/burger2/")
    look(hub, "/burger1/")
    look(hub, "/burger1/", "/burger2/")
    assert browser.shown == [("/burger2/", False)]


def test_a_page_whose_robot_is_switched_off_does_not_drive_another(hub):
    browser = meet(hub)
    look(hub, "/")
    look(hub, "/burger1/")
    assert browser.robot.namespace == "/"
    assert meet(hub, "/burger2/").robot.namespace == "/burger2/"


def test_a_page_that_asks_for_what_no_namespace_is_called_gets_a_robot(hub):
    look(hub, "/burger1/")
    for name in ("/a b/", "~x", "/\ud800/"):
        assert meet(hub, name).robot.namespace == "/burger1/"


def test_a_page_cannot_have_the_node_listen_to_one_name_after_the_other(hub):
    browser = meet(hub)
    look(hub, "/")
    for name in ("/one/", "/two/"):
        hub.join(browser, name)
    assert set(hub.robots) == {"/"}


def test_a_page_asked_for_a_robot_of_the_list_shows_it(hub):
    browser = meet(hub)
    look(hub, "/burger1/", "/burger2/")
    hub.join(browser, "/burger2/")
    look(hub, "/burger1/", "/burger2/")
    assert browser.shown[-1] == ("/burger2/", False)


@pytest.mark.parametrize("end", [
    lambda hub, browser: hub.leave_robot(browser), lambda hub, _browser: hub.close()], ids=["page", "node"])
def test_a_robot_stops_with_the_page_or_the_node_by_which_it_is_driven(hub, monkeypatch, end):
    """Not only once the hand has been silent for too long, which here it never is."""
    monkeypatch.setattr(dead_man, "PATIENCE", 1e9)
    browser, sent = meet(hub), []
    browser.robot.hands._publishers["cmd_vel"] = SimpleNamespace(
        get_num_connections=lambda: 1, publish=lambda message: sent.append(message.linear.x), unregister=lambda: None)
    browser.robot.hands.push(browser, Twist2D(0.2, 0.0, 0.0))
    wait_until(lambda: sent, "a velocity")
    end(hub, browser)
    assert sent[0] == 0.2 and sent[-1] == 0.0

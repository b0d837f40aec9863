"""A node is there as soon as its master has answered, and logs as its user wants it."""

import os

import pytest
import rospkg
from rospy.impl.statistics import SubscriberStatisticsLogger

from mbf_relay.ros.common.rospy_patches import starting


@pytest.fixture(autouse=True)
def nothing_chosen(monkeypatch, tmp_path):
    monkeypatch.setenv(starting.LOGGING, "")  # so that what is set below is taken back for the tests behind
    monkeypatch.delenv(starting.LOGGING)
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    monkeypatch.setenv("ROS_ETC_DIR", str(tmp_path / "etc"))
    monkeypatch.setattr("rospy.impl.init.time", __import__("time"))
    monkeypatch.setattr(SubscriberStatisticsLogger, "is_enabled", SubscriberStatisticsLogger.is_enabled)


def own_file(folder, ending):
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"python_logging.{ending}"
    path.write_text("")
    return str(path)


def test_logging_is_configured_by_the_file_rospy_would_find_among_all_packages(monkeypatch):
    rosgraph = rospkg.RosPack().get_path("rosgraph")
    monkeypatch.setenv("ROS_PACKAGE_PATH", f"/nowhere:{os.path.dirname(rosgraph)}")
    assert os.path.splitext(starting.logging_configuration())[0] == os.path.join(rosgraph, "conf", "python_logging")


@pytest.mark.parametrize("folder", ["config", "etc"])
@pytest.mark.parametrize("ending", ["conf", "yaml"])
def test_a_users_own_file_goes_before_rosgraphs(tmp_path, folder, ending):
    path = own_file(tmp_path / folder, ending)
    starting.apply_patches()
    assert os.environ[starting.LOGGING] == path


def test_what_the_user_names_stays(monkeypatch, tmp_path):
    own_file(tmp_path / "config", "conf")
    monkeypatch.setenv(starting.LOGGING, "mine.conf")
    starting.apply_patches()
    assert os.environ[starting.LOGGING] == "mine.conf"


def test_where_rosgraph_lies_elsewhere_rospy_looks_for_it_itself(monkeypatch, tmp_path):
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path))
    starting.apply_patches()
    assert starting.LOGGING not in os.environ


def test_the_masters_answer_is_looked_for_at_once_and_then_ever_less_often(monkeypatch):
    slept = []
    monkeypatch.setattr("time.sleep", slept.append)
    clock = starting.SlowingClock()
    for _ in range(2000):
        clock.sleep(0.1)
    assert slept[0] <= 0.001 and slept == sorted(slept)
    assert set(slept[20:]) == {0.1}, "as seldom as rospy where there is no master"


def test_rospy_waits_by_it(monkeypatch):
    import rospy.impl.init

    starting.apply_patches()
    assert isinstance(rospy.impl.init.time, starting.SlowingClock)


@pytest.mark.parametrize("answer", [True, False])
def test_the_master_is_asked_for_statistics_once_and_not_for_each_subscription(monkeypatch, answer):
    asked = []
    monkeypatch.setattr("rospy.get_param", lambda *names: asked.append(names) or answer)
    starting.apply_patches()
    assert {SubscriberStatisticsLogger.is_enabled() for _ in range(5)} == {answer}
    assert asked == [("/enable_statistics", False)]

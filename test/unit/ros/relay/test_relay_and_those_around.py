"""What the relay shows of its goals, whose lock it takes, and how long it lets a server take for an answer."""

import threading

import pytest
from fake_server import ACTIVE, RECALLED, SUCCEEDED, FakeServer, PaperClientGoal, Recorder, Setup
from mbf_msgs.msg import MoveBaseResult

from mbf_relay.ros.common.actions.client_goals import RESEND_AFTER
from mbf_relay.ros.relay.relay import Relay, RelayParameters


def test_rviz_shows_where_the_robot_is_sent_and_nothing_that_it_is_not_sent_to():
    setup = Setup()
    setup.goal(x=3.0, stamp=10.0)
    assert setup.goal(x=4.0, stamp=9.0).state == RECALLED
    setup.goal(x=float("nan"), stamp=11.0)
    setup.goal(x=5.0, stamp=12.0)
    assert [pose.pose.position.x for pose in setup.observer.taken] == [3.0, 5.0]


def test_a_robot_is_shown_where_the_server_saw_it_while_it_drives():
    setup = Setup()
    seen = []
    setup.observer.robot_seen = seen.append
    setup.goal()
    setup.server.sent[0].say(1.5)
    assert [pose.pose.position.x for pose in seen] == [1.5]


class CountedLock:
    """A re-entrant lock that knows how often it is held."""

    def __init__(self):
        self._lock, self.depth = threading.RLock(), 0

    def __enter__(self):
        self._lock.acquire()
        self.depth += 1

    def __exit__(self, *_error):
        self.depth -= 1
        self._lock.release()


class LockedGoal(PaperClientGoal):
    """A goal whose state is changed with the action server's lock held."""

    lock = None

    def _go(self, allowed, text):
        assert self.lock.depth == 1, "two locks, taken in two orders, would hang relay and robot"
        super()._go(allowed, text)


def test_a_goal_and_a_server_s_answer_that_meet_do_not_wait_for_each_other_for_ever():
    """Goals come with the action server's lock held, and take it: a lock of the relay's own would be a second one."""
    lock = CountedLock()
    server = FakeServer(lambda: 0.0)
    relay = Relay(
        server, lambda pose: pose, RelayParameters(), Recorder(lambda: 0.0), lock=lock, clock=lambda: 0.0)
    goal = LockedGoal("g1")
    goal.lock = lock
    relay.take_goal(goal, 1e6)
    server.sent[0].end(SUCCEEDED, MoveBaseResult.SUCCESS)
    assert goal.states[-2:] == [ACTIVE, SUCCEEDED] and lock.depth == 0


@pytest.mark.parametrize("server_timeout", [0.0, 1.0, 60.0])
def test_a_goal_that_gets_lost_on_its_way_is_sent_twice_more_before_it_is_given_up(server_timeout):
    given = RelayParameters(server_timeout=server_timeout).acknowledge_timeout
    assert given >= server_timeout and given > 2.0 * RESEND_AFTER

"""A simulation that keeps to another one's clock."""

import pytest
from rosgraph_msgs.msg import Clock

from mbf_relay.ros.simulator import neighbours


class Follower:
    """A simulation of steps of 0.25 s behind a leader's clock."""

    def __init__(self, monkeypatch):
        monkeypatch.setattr(neighbours.rospy, "Subscriber", lambda *_, **__: None)
        monkeypatch.setattr(neighbours, "PATIENCE", 0.001)
        self.now = 1.0
        self.pacer = neighbours.ClockFollower(lambda: self.now, lambda now: setattr(self, "now", now))

    def hear(self, seconds):
        self.pacer._take(Clock(neighbours.rospy.Time.from_sec(seconds)))

    def step(self):
        """Take a step; return whether the next one is due."""
        self.now += 0.25
        return self.pacer.pace(0.25)


@pytest.fixture
def follower(monkeypatch):
    made = Follower(monkeypatch)
    assert not made.step()  # nobody makes a clock yet
    return made


def test_a_follower_that_comes_late_begins_at_the_leader_s_time(follower):
    follower.hear(500.0)
    assert follower.pacer.pace(0.25) and follower.now == 500.0


def test_it_keeps_to_the_clock_and_makes_up_for_what_it_missed(follower):
    follower.hear(2.0)
    assert follower.pacer.pace(0.25) and not follower.step()
    follower.hear(2.5)
    assert follower.pacer.pace(0.25) and follower.step() and not follower.step()
    assert follower.now == 2.75


def test_a_robot_goes_on_after_its_leader_was_started_again(follower):
    follower.hear(500.0)
    assert follower.pacer.pace(0.25)
    follower.hear(1.0)
    assert follower.pacer.pace(0.25) and follower.now == 1.0
    assert not follower.step()
    follower.hear(1.25)
    assert follower.pacer.pace(0.25) and follower.now == 1.25


def test_who_waits_for_a_leader_that_is_paused_may_do_what_is_asked_of_it_meanwhile(follower):
    follower.hear(2.0)
    assert follower.pacer.pace(0.25)
    for _ in range(3):
        follower.hear(2.0)
        assert not follower.step()

"""What the simulator publishes: to all who listen, and with no work for what nobody does."""

from types import SimpleNamespace

import numpy as np
import pytest

from mbf_relay.ros.simulator import messages, topics
from mbf_relay.simulation.contacts import Contact
from mbf_relay.simulation.imu import ImuReading
from mbf_relay.simulation.node_parameters import SimulatorParameters
from mbf_relay.simulation.observations import JointReading, Observations

SEEN = Observations(
    imu=ImuReading(1.0, (0.0, 0.0, 0.0, 1.0), np.zeros(3), np.zeros(3), 0.01, 0.1),
    joints=JointReading(1.0, (0.1, 0.2), (0.3, 0.4), ("left", "right")))


class Publisher:
    """A publisher with so many listeners."""

    listeners = 0
    sent = []

    def __init__(self, topic, *_arguments, **_options):
        self.topic = topic

    def get_num_connections(self):
        return self.listeners

    def publish(self, _message):
        self.sent.append(self.topic)


@pytest.fixture
def made(monkeypatch):
    """The messages that were made, by what makes them."""
    found = []
    for name in ("imu_to_message", "joints_to_message"):
        monkeypatch.setattr(messages, name, lambda *_arguments, name=name: found.append(name))
    monkeypatch.setattr(topics.rospy, "Publisher", Publisher)
    monkeypatch.setattr(Publisher, "sent", [])
    return found


def test_a_small_computer_makes_no_message_that_nobody_hears(made):
    """Sixty a simulated second were of an inertial sensor that few robots read."""
    of_simulator = topics.SimulatorTopics(SimulatorParameters())
    of_simulator.publish(None, SEEN, steps=1)
    assert made == [] and Publisher.sent == []


def test_who_comes_later_hears_all_that_is_read_from_then_on(made, monkeypatch):
    of_simulator = topics.SimulatorTopics(SimulatorParameters())
    of_simulator.publish(None, SEEN, steps=1)
    monkeypatch.setattr(Publisher, "listeners", 1)
    of_simulator.publish(None, SEEN, steps=2)
    assert Publisher.sent == ["joint_states", "imu"]


def test_a_collision_is_told_of_once_and_again_after_the_clock_was_set_back(made, monkeypatch):
    monkeypatch.setattr(topics.rospy, "logwarn", lambda *_: None)
    of_simulator = topics.SimulatorTopics(SimulatorParameters())
    touch = Observations(contacts=(Contact("wall", (1.0, 2.0, 0.1), (1.0, 0.0, 0.0)),))
    told = []
    for now in (500.0, 500.05, 500.1, 1.0):
        of_simulator.publish(SimpleNamespace(now=now), touch, steps=1)
        told.append((of_simulator.contacts, Publisher.sent.count("contacts")))
    assert told == [(1, 1), (1, 1), (1, 2), (2, 3)]


def test_a_covariance_of_x_y_and_heading_stands_where_a_message_has_them():
    planar = np.arange(1.0, 10.0).reshape(3, 3)
    found = np.reshape(messages.covariance_of_six(planar), (6, 6))
    assert (found[np.ix_((0, 1, 5), (0, 1, 5))] == planar).all()
    assert list(found[(2, 3, 4), (2, 3, 4)]) == [messages.UNMEASURED] * 3
    assert np.count_nonzero(found) == 12

"""What is made of markers that put obstacles into the simulated world."""

import queue
from types import SimpleNamespace

import pytest

pytest.importorskip("pybullet")

from std_msgs.msg import Header  # noqa: E402
from visualization_msgs.msg import Marker, MarkerArray  # noqa: E402

from mbf_relay.ros.common.checks import InvalidMessage  # noqa: E402
from mbf_relay.ros.simulator import obstacles  # noqa: E402
from mbf_relay.ros.simulator.node import Simulator  # noqa: E402
from mbf_relay.ros.simulator.obstacles import obstacle_from_marker  # noqa: E402


@pytest.mark.parametrize("frame", ["odom", pytest.param("a" * 2000000, id="endless")])
def test_an_obstacle_in_another_frame_is_refused_without_filling_the_log(frame):
    with pytest.raises(InvalidMessage, match="frame '.*'; it must be 'world'") as refusal:
        obstacle_from_marker(Marker(header=Header(frame_id=frame)), "world")
    assert len(str(refusal.value)) < 300


def test_an_obstacle_stands_for_as_long_as_it_was_put_there_though_the_clock_is_set_back(monkeypatch):
    monkeypatch.setattr(obstacles.rospy, "Publisher", lambda *_, **__: SimpleNamespace(publish=lambda _message: None))
    simulation = SimpleNamespace(now=500.0, true_pose=None, scene=Scene())
    placed = obstacles.Obstacles(simulation, "map")
    marker = Marker(ns="a", id=1, type=Marker.CUBE, lifetime=obstacles.rospy.Duration(10))
    marker.scale.x = marker.scale.y = marker.scale.z = 0.2
    placed.take(MarkerArray([marker]))
    simulation.now = 505.0
    placed.shift(1.0 - simulation.now)
    for now, there in ((1.0, 1), (5.75, 1), (6.25, 0)):
        simulation.now = now
        placed.expire()
        assert len(simulation.scene.obstacles) == there


def test_a_simulation_does_not_stand_while_a_program_sends_many_obstacles_one_by_one(monkeypatch):
    """With each all were told anew, half a million markers for a thousand: the clock stood for eight seconds."""
    told = []
    monkeypatch.setattr(obstacles.rospy, "Publisher", lambda *_, **__: SimpleNamespace(publish=told.append))
    simulator = Simulator.__new__(Simulator)
    simulator._requests = queue.Queue()
    simulator._obstacles = obstacles.Obstacles(SimpleNamespace(now=5.0, true_pose=None, scene=Scene()), "map")
    for number in range(50):
        marker = Marker(ns="a", id=number, type=Marker.CUBE)
        marker.scale.x = marker.scale.y = marker.scale.z = 0.2
        simulator._take_obstacles(MarkerArray([marker]))
    for _ in range(2):
        simulator._do_requests()
    assert [len(message.markers) for message in told] == [1, 51]


class Scene:
    """Where obstacles stand."""

    def __init__(self):
        self.obstacles = {}
        self.set_obstacle, self.remove_obstacle = self.obstacles.__setitem__, self.obstacles.pop

    def obstructs(self, *_):
        return False

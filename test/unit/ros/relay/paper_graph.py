"""Relay, server and robot in one thread on one clock, with a network between that delays, loses and is cut; no ROS.

What is real: the relay's core, the client's and the servers' goals, the server's actions, the navigator. What is of
paper: topics, processes (which can be killed, stopped and started), plugins, and the wheels, which keep the last
    velocity.
"""

import collections
import sys
from pathlib import Path

from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from genpy import Time
from geometry_msgs.msg import PoseStamped
from mbf_msgs.msg import MoveBaseActionFeedback, MoveBaseActionGoal, MoveBaseActionResult
from mbf_msgs.msg import MoveBaseGoal as ServerGoalMessage
from move_base_msgs.msg import MoveBaseGoal, MoveBaseResult

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "navigation"))

import scripted  # noqa: E402
from scripted_bench import Bench  # noqa: E402

from mbf_relay.geometry import STOP, Twist2D  # noqa: E402
from mbf_relay.ros.common.actions.client_goals import ClientGoals  # noqa: E402
from mbf_relay.ros.common.actions.goal_tracker import HELD_BACK_FOR, GoalTracker  # noqa: E402
from mbf_relay.ros.relay.relay import Observer, Relay, RelayParameters  # noqa: E402
from mbf_relay.ros.server.actions import make_actions  # noqa: E402

STEP = 0.1
"""Time (s) of one round."""
SILENCE = 0.8
"""Time (s) after which a server that says nothing is lost, as the relay's watch takes it."""
CLOSED = 0.3
"""Time (s) after which one whose connection is closed is."""


class Network:
    """Topics between two machines, each in order."""

    def __init__(self):
        self.now, self.delays, self.is_cut = 0.0, collections.Counter(), False
        self.arrived = {}  # topic: when its last message did
        self._takers, self._waiting = {}, collections.defaultdict(collections.deque)

    def subscribe(self, topic, take, runs=lambda: True):
        self._takers[topic] = (take, runs)

    def publish(self, topic, message):
        self._waiting[topic].append((self.now + self.delays[topic], message))

    def lose(self, topic):
        """Lose what is on its way."""
        self._waiting[topic].clear()

    def close(self, *topics):
        """End the connections."""
        for topic in topics:
            self._takers.pop(topic, None)
            self.lose(topic)

    def deliver(self):
        for topic, queue in list(self._waiting.items()):
            take, runs = self._takers.get(topic, (None, lambda: True))
            while queue and runs() and (self.is_cut or queue[0][0] <= self.now):
                message = queue.popleft()[1]
                if take is not None and not self.is_cut:
                    self.arrived[topic] = self.now
                    take(message)


def as_it_is(status):
    """Return a goal's state as a message has it that is on its way while the state changes."""
    return GoalStatus(status.goal_id, status.status, status.text)


def steer(state):
    """Go along x to where the newest path leads."""
    away = newest_goal().x - state.pose.x
    return Twist2D(max(-0.2, min(0.2, 2.0 * away)), 0.0, 0.0)


def newest_goal():
    """Return where the newest path leads."""
    return scripted.SCRIPT.paths[-1][0].goal


class PaperActionServer:
    """An action server's goals over the network; constructor as ActionServer's."""

    topics = ("goal", "cancel", "lease")

    def __init__(self, graph, name, on_goal, on_cancel, recalled, overtaken_cb):
        self.goals = GoalTracker(
            self, on_goal, on_cancel, MoveBaseResult, lambda: graph.now, graph.ros_now, recalled, overtaken_cb,
            HELD_BACK_FOR)
        self._graph, self._told_at = graph, 0.0
        self.is_connected = name.endswith("move_base")

    def connect(self, runs):
        subscribe = self._graph.network.subscribe
        subscribe("goal", lambda message: self.goals.take_goal(message.goal_id, message.goal, "/move_base"), runs)
        subscribe("cancel", self.goals.take_cancel, runs)
        subscribe("lease", lambda message: self.goals.renew(message.id), runs)

    def step(self):
        if self._graph.now - self._told_at >= 0.2 - 1e-9:
            self.status_changed()
            self._told_at = self._graph.now
        self.goals.update()

    def publish_result(self, status, result):
        self._publish("result", MoveBaseActionResult(status=as_it_is(status), result=result))

    def publish_feedback(self, status, feedback):
        self._publish("feedback", MoveBaseActionFeedback(status=as_it_is(status), feedback=feedback))

    def status_changed(self):
        self._publish("status", GoalStatusArray(status_list=list(map(as_it_is, self.goals.listed()))))

    def _publish(self, topic, message):
        if self.is_connected:
            self._graph.network.publish(topic, message)


class Server:
    """One life of the server."""

    def __init__(self, graph):
        self._graph, self.is_stopped, self.resumed_at = graph, False, graph.now
        self.bench = Bench(planner_frequency=2.0)
        self.bench.robot.command = self._command
        self._servers = []
        self.actions = make_actions(self.bench.navigator, self._make_server, graph.ros_now)

    def _make_server(self, name, _action_type, on_goal, on_cancel, recalled, overtaken_cb):
        server = PaperActionServer(self._graph, name, on_goal, on_cancel, recalled, overtaken_cb)
        self._servers.append(server)
        return server

    def connect(self):
        self._servers[-1].connect(lambda: not self.is_stopped)

    def step(self, now):
        bench = self.bench
        bench.now = now
        for action in self.actions:
            action.take_up()
        bench.navigator.update(now)
        for action in self.actions:
            action.report()
        self._servers[-1].step()

    def _command(self, velocity):
        self.bench.robot.commanded = velocity
        self.bench.robot.sent.append(velocity)
        self._graph.wheels, self._graph.driver = velocity, self


class RelayLife(Observer):
    """One life of the relay, with its action server towards the clients, and what those were told."""

    def __init__(self, graph, number):
        self._graph, self.is_stopped, self.born_at = graph, False, graph.now
        self.results, self.sent = [], []
        self._up, self._heard_at, self._connected_at, self._checked_at = False, 0.0, 0.0, 0.0
        self.takes_leases = True
        self.goals = ClientGoals(
            "/move_base_flex/move_base", "/move_base", MoveBaseActionGoal, self, 20.0, lambda: graph.now, graph.ros_now,
            life=f"{number:08x}")
        self.front = GoalTracker(
            self,
            lambda goal: self.relay.take_goal(goal, graph.ros_now().to_sec()),
            lambda goal: self.relay.take_cancel(goal),
            MoveBaseResult,
            lambda: graph.now,
            graph.ros_now,
            held_back_for=HELD_BACK_FOR,
            on_overtaken=lambda goal: self.relay.take_overtaken(goal, graph.ros_now().to_sec()),
        )
        self.relay = Relay(
            self,
            lambda pose: ServerGoalMessage(target_pose=pose),
            RelayParameters(),
            self,
            self.front.lock,
            lambda: graph.now,
        )
        runs = lambda: not self.is_stopped  # noqa: E731
        graph.network.subscribe("status", self._hear, runs)
        graph.network.subscribe("result", self.goals.take_result, runs)
        graph.network.subscribe("feedback", self.goals.take_feedback, runs)

    @property
    def wants_motion(self):
        """Whether it runs and has a goal that nobody cancelled."""
        active = self.relay._current
        return not self.is_stopped and active is not None and active.cancelled_at is None

    # what the relay asks of its server's client

    @property
    def server_is_up(self):
        return self._up and self._graph.server is not None

    def send(self, goal, on_feedback, on_end):
        return self.goals.send(goal, on_feedback, on_end)

    def publish_goal(self, message):
        self._graph.network.publish("goal", message)

    def publish_cancel(self, goal_id):
        self._graph.network.publish("cancel", goal_id)

    def renew(self, goal_id):
        self._graph.network.publish("lease", goal_id)

    # what it tells

    def publish_result(self, status, _result):
        self.results.append((status.goal_id.id, status.status))

    def publish_feedback(self, status, _feedback):
        assert status.goal_id.id not in dict(self.results), "feedback of a goal that has ended"

    def status_changed(self):
        ended = dict(self.results)
        for status in self.front.listed():
            name = status.goal_id.id
            assert name not in ended or status.status == ended[name], f"{name} went on after its result"

    def stop_robot(self):
        self._graph.network.publish("cmd_vel", STOP)

    # its work

    def step(self, now):
        if now - self._checked_at < 0.1 - 1e-9:
            return
        self._checked_at = now
        if self._graph.server is not None:
            self._connected_at = now
        lost = None
        if self._up and now - self._connected_at > CLOSED:
            lost = "died"
        elif self._up and now - self._heard_at > SILENCE:
            lost = "hangs"
        self._up = self._up and lost is None
        self.goals.check(lost)
        self.relay.check()
        self.front.update()

    def _hear(self, message):
        self._up, self._heard_at = True, self._graph.now
        self.goals.take_status(message)


class Graph:
    """Everything together. `lives` holds every relay there was; the last is the present one unless it is dead."""

    def __init__(self):
        self.now, self.network, self.wheels = 100.0, Network(), STOP
        self.network.now = self.now
        self.lives, self.server, self.relay, self.driver = [], None, None, None
        self.wanted_at = self.pose = None
        self.server_gone_at = self.now
        self.network.subscribe("cmd_vel", self._take_velocity)
        self.start_server()
        self.start_relay()
        self.run(1.0)

    def ros_now(self):
        return Time.from_sec(self.now)

    def start_server(self):
        if self.server is None:
            self.server = Server(self)
            script = self.server.bench.script
            script.velocity, script.reached = steer, lambda state: abs(newest_goal().x - state.pose.x) < 0.05
            self.server.connect()
            if self.server.bench.robot.commanded in (None, STOP):
                self.wheels = STOP  # who connects to cmd_vel is told to stand

    def start_relay(self):
        if self.relay is None:
            self.relay = RelayLife(self, len(self.lives))
            self.lives.append(self.relay)

    def kill_server(self):
        if self.server is not None:
            if self.server is self.driver and not self.server.is_stopped:
                self.server_gone_at = self.now
            self.server = None
            self.network.close("goal", "cancel", "lease")

    def kill_relay(self):
        if self.relay is not None:
            self.relay = None
            self.network.close("status", "result", "feedback")

    def stop(self, process):
        """Send SIGSTOP."""
        if process is not None and not process.is_stopped:
            process.is_stopped = True
            self.server_gone_at = self.now if process is self.server else self.server_gone_at

    def go_on(self, process):
        """Send SIGCONT."""
        if process is not None and process.is_stopped:
            process.is_stopped, process.resumed_at = False, self.now

    def goal(self, name, x=1.0, w=1.0):
        """Have a client send a goal."""
        pose = PoseStamped()
        pose.header.frame_id, pose.pose.position.x, pose.pose.orientation.w = "map", x, w
        if self.relay is not None and not self.relay.is_stopped:
            self.relay.sent.append(name)
            self.relay.front.take_goal(GoalID(self.ros_now(), name), MoveBaseGoal(pose), "client")
            self.note_wish()

    def cancel(self, name=""):
        """Have a client cancel a goal, or all."""
        if self.relay is not None and not self.relay.is_stopped:
            self.relay.front.take_cancel(GoalID(id=name))

    def run(self, seconds):
        """Let time pass and look at the robot all the while."""
        for _ in range(round(seconds / STEP)):
            self.note_wish()
            self.now = self.network.now = self.now + STEP
            self.network.deliver()
            if self.server is not None and not self.server.is_stopped:
                self.server.bench.robot.move(STEP)
                self.server.step(self.now)
            if self.relay is not None and not self.relay.is_stopped:
                self.relay.step(self.now)
            self.note_wish()
            self.check_robot()

    def note_wish(self):
        """Remember when somebody last wanted the robot to move."""
        if self.relay is not None and self.relay.wants_motion:
            self.wanted_at = self.now

    def check_robot(self):
        """No goal, no velocity: within a second of the last wish, of the server's end, or of its coming to itself.

        What it said before its end counts until it has arrived: nobody can tell a late word from a living server's.
        """
        assert self.wheels.is_finite()
        if self.wheels == STOP:
            return
        server = self.server
        if server is not None and server is self.driver and not server.is_stopped:
            since = max(self.wanted_at or 0.0, server.resumed_at)
            assert self.now - since <= 1.0 + 1e-6, f"driven for {self.now - since:.2f} s for nobody"
        elif self.relay is not None and not self.relay.is_stopped and not self.network.is_cut:
            knows = (
                self.relay.born_at < self.server_gone_at - 1.0
                and getattr(self.relay, "resumed_at", 0.0) < self.server_gone_at
            )
            if knows and not self.network.delays["cmd_vel"] and self.cut_ended_before(self.server_gone_at):
                since = max(self.server_gone_at, self.network.arrived.get("status", 0.0))
                assert self.now - since <= 1.2, "driven on by a server that is gone"

    def cut_ended_before(self, moment):
        return getattr(self, "cut_until", 0.0) < moment

    def cut(self, is_cut):
        """Pull the cable between relay and server, or put it back."""
        self.network.is_cut, self.cut_until = is_cut, self.now if not is_cut else float("inf")

    def _take_velocity(self, velocity):
        self.wheels = velocity

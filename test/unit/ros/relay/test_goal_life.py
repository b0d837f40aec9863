"""The whole life of a goal, from client through relay and server to the wheels, whatever is lost, late or dead.

Two things hold at every moment: each goal ends once, and a robot for which nobody has a goal stands within a second.
"""

import collections
import gc
import math

import pytest
from actionlib_msgs.msg import GoalID, GoalStatus
from geometry_msgs.msg import PoseStamped
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule
from mbf_msgs.msg import MoveBaseActionGoal, MoveBaseGoal
from paper_graph import STEP, Graph, scripted, steer
from tally import how_many, trial

from mbf_relay.geometry import STOP
from mbf_relay.outcomes import ControlError, ControlOutcome
from mbf_relay.ros.common.actions.goal_tracker import REMEMBER_FOR

RUNS = how_many(60, 10000)
TOPICS = st.sampled_from(["goal", "cancel", "lease", "status", "result", "feedback", "cmd_vel"])
PLANS = st.sampled_from([scripted.line, scripted.line, scripted.line, scripted.NO_WAY, RuntimeError("broken")])
DRIVES = st.sampled_from([
    steer, steer, steer, scripted.FORWARD, scripted.STUCK, ValueError("broken"),
    ControlError(ControlOutcome.TF_ERROR, "lost")])


@pytest.fixture
def graph():
    graph = Graph()
    graph.goal("a", x=50.0)
    graph.run(1.0)
    assert graph.wheels != STOP
    return graph


def held():
    """Return how many objects there are of each class that goals are made of, here and in messages."""
    gc.collect()
    kinds = [type(each) for each in gc.get_objects()]
    rooms = ("mbf_relay.ros.", "mbf_relay.navigation.task", "actionlib_msgs.", "move_base_msgs.", "mbf_msgs.")
    return collections.Counter(kind.__qualname__ for kind in kinds if str(kind.__module__).startswith(rooms))


def send_many(graph, goals, begin):
    """Send goals that replace each other, have some called off, and wait until they are remembered no longer."""
    for index in range(begin, begin + goals):
        graph.goal(f"many {index}", x=50.0)
        if index % 3 == 0:
            graph.cancel(f"many {index}")
        graph.run(STEP)
    graph.cancel()
    graph.run(REMEMBER_FOR + 10.0)


def test_nodes_that_have_had_a_thousand_goals_hold_no_more_than_after_a_few(graph):
    send_many(graph, 50, 0)
    few = held()
    send_many(graph, 1000, 50)
    grown = {kind: (few[kind], count) for kind, count in held().items() if count > few[kind] + 20}
    assert len(graph.relay.results) == 1051 and not grown


def stands(graph):
    graph.run(1.0)
    return graph.wheels == STOP


@pytest.mark.parametrize("first", ["goal", "cancel"])
def test_a_robot_stands_where_the_server_s_own_client_replaces_its_goal_and_calls_that_off_at_once(first):
    """The newer goal ended before it began, and the robot drove on to the older one, of which its client knew no more.
    """
    graph, ended = Graph(), {}
    graph.kill_relay()
    graph.wanted_at = math.inf  # by whom the graph does not know
    graph.network.subscribe("result", lambda message: ended.update({message.status.goal_id.id: message.status.status}))
    send(graph, "old", x=50.0)
    graph.run(1.0)
    assert graph.wheels != STOP
    if first == "cancel":  # each comes by a connection of its own
        graph.network.publish("cancel", GoalID(id="new"))
        graph.run(STEP)
    send(graph, "new", x=20.0)
    graph.network.publish("cancel", GoalID(id="new"))
    assert stands(graph)
    assert ended == {"old": GoalStatus.PREEMPTED, "new": GoalStatus.RECALLED}


def send(graph, name, x):
    """Send the server a goal without a relay."""
    pose = PoseStamped()
    pose.header.frame_id, pose.pose.position.x, pose.pose.orientation.w = "map", x, 1.0
    graph.network.publish(
        "goal", MoveBaseActionGoal(goal_id=GoalID(graph.ros_now(), name), goal=MoveBaseGoal(target_pose=pose)))


def test_a_robot_whose_relay_was_killed_stands_within_a_second(graph):
    graph.kill_relay()
    assert stands(graph)


def test_a_robot_whose_relay_was_stopped_stands_within_a_second_and_its_client_hears_why(graph):
    graph.stop(graph.relay)
    assert stands(graph)
    graph.go_on(graph.relay)
    graph.run(1.0)
    assert graph.relay.results == [("a", GoalStatus.PREEMPTED)]


def test_a_robot_whose_relay_is_behind_a_cut_cable_stands_within_a_second(graph):
    graph.cut(True)
    assert stands(graph)


def test_a_relay_that_starts_calls_back_the_robot_its_predecessor_sent_out(graph):
    graph.kill_relay()
    graph.start_relay()
    graph.run(0.4)
    assert graph.wheels == STOP


def test_a_robot_whose_server_is_stopped_is_stopped_within_a_second_by_the_relay(graph):
    graph.stop(graph.server)
    assert stands(graph) and graph.relay.results == [("a", GoalStatus.ABORTED)]


def test_a_robot_whose_server_is_stopped_while_its_status_is_late_stands_a_second_after_the_last_of_it(graph):
    graph.network.delays["status"] = 0.3
    graph.run(0.1)
    graph.stop(graph.server)
    graph.run(0.4)
    assert stands(graph) and graph.relay.results == [("a", GoalStatus.ABORTED)]


def test_a_robot_whose_server_was_killed_is_stopped_by_the_relay_and_the_next_goal_works(graph):
    graph.kill_server()
    assert stands(graph) and graph.relay.results == [("a", GoalStatus.ABORTED)]
    graph.start_server()
    graph.run(0.5)
    graph.goal("b")
    graph.run(20.0)
    assert graph.relay.results[-1] == ("b", GoalStatus.SUCCEEDED)


def test_a_robot_whose_server_hangs_stands_though_what_it_is_told_first_gets_lost(graph):
    graph.stop(graph.server)
    for _ in range(9):
        graph.run(0.1)
        graph.network.lose("cmd_vel")
        if graph.relay.results:
            break
    assert stands(graph) and graph.relay.results == [("a", GoalStatus.ABORTED)]


def test_a_robot_whose_cancel_got_lost_stands_within_a_second(graph):
    graph.cancel("a")
    graph.network.lose("cancel")
    assert stands(graph)


def test_a_robot_whose_goal_and_cancel_got_lost_is_not_sent_out_before_the_cancel_is_known(graph):
    graph.cancel()
    graph.run(1.0)
    graph.cut(True)
    graph.goal("b", x=50.0)
    graph.cancel("b")
    graph.run(0.1)
    graph.network.delays["cancel"] = 0.3
    graph.cut(False)
    for _ in range(60):
        graph.run(0.1)
        assert graph.wheels == STOP
    assert graph.relay.results[-1] == ("b", GoalStatus.PREEMPTED)


@pytest.mark.parametrize("broken", [{"x": float("nan")}, {"x": float("inf")}])
def test_a_robot_sent_into_nowhere_goes_on_where_it_was_sent_and_can_be_called_back(graph, broken):
    graph.goal("b", **broken)
    graph.run(1.0)
    assert graph.relay.results == [("b", GoalStatus.ABORTED)] and graph.wheels != STOP
    graph.cancel()
    assert stands(graph) and ("a", GoalStatus.PREEMPTED) in graph.relay.results


def test_a_robot_whose_next_goal_the_server_refuses_is_called_back(graph):
    graph.server.bench.script.plan = scripted.NO_WAY
    graph.server.bench.navigator.parameters = graph.server.bench.navigator.parameters.replace(recovery_enabled=False)
    graph.goal("b", w=0.0)
    assert stands(graph)
    assert graph.relay.results == [("a", GoalStatus.PREEMPTED), ("b", GoalStatus.ABORTED)]


class GoalLife(RuleBasedStateMachine):
    """Clients, processes and a network that do as they please."""

    def __init__(self):
        super().__init__()
        self.graph, self.count = Graph(), 0

    @rule(
        x=st.sampled_from([1.0, 1.0, 40.0, 40.0, float("nan"), float("-inf"), 1e300]),
        w=st.sampled_from([1.0, 1.0, 1.0, 0.0]),
    )
    def goal(self, x, w):
        self.count += 1
        self.graph.goal(f"goal {self.count}", x, w)

    @rule(back=st.integers(0, 3))
    def cancel(self, back):
        self.graph.cancel(f"goal {max(1, self.count - back)}")

    @rule()
    def cancel_everything(self):
        self.graph.cancel()

    @rule(seconds=st.sampled_from([0.1, 0.2, 0.3, 0.7, 1.5, 3.0]))
    def time_passes(self, seconds):
        self.graph.run(seconds)

    @rule(topic=TOPICS)
    def messages_are_lost(self, topic):
        self.graph.network.lose(topic)

    @rule(topic=TOPICS, delay=st.sampled_from([0.0, 0.1, 0.3]))
    def messages_are_late(self, topic, delay):
        self.graph.network.delays[topic] = delay

    @rule(is_cut=st.booleans())
    def the_cable(self, is_cut):
        self.graph.cut(is_cut)

    @rule(what=st.sampled_from(["kill_relay", "kill_server", "start_relay", "start_server"]))
    def a_process(self, what):
        getattr(self.graph, what)()

    @rule(whose=st.sampled_from(["relay", "server"]), is_stopped=st.booleans())
    def a_signal(self, whose, is_stopped):
        (self.graph.stop if is_stopped else self.graph.go_on)(getattr(self.graph, whose))

    @rule(plan=PLANS, drive=DRIVES)
    def plugins(self, plan, drive):
        script = scripted.SCRIPT
        script.plan, script.velocity = plan, drive

    @invariant()
    def each_goal_has_one_terminal_state(self):
        for life in self.graph.lives:
            names = [name for name, _state in life.results]
            assert len(names) == len(set(names))

    @trial("lives of a goal, whatever is lost, late or dead")
    def teardown(self):
        """When everything is mended, all goals end, the robot stands, and the next goal is reached."""
        graph = self.graph
        graph.network.delays.clear()
        graph.cut(False)
        for process in (graph.relay, graph.server):
            graph.go_on(process)
        graph.start_relay()
        graph.start_server()
        scripted.SCRIPT.plan, scripted.SCRIPT.velocity = scripted.line, steer
        graph.run(2.0)
        graph.cancel()
        graph.run(6.0)
        assert graph.wheels == STOP
        assert {name for name, _state in graph.relay.results} == set(graph.relay.sent), "a goal never ended"
        graph.goal("the next goal", x=graph.server.bench.robot.pose.x + 0.2)
        graph.run(4.0)
        assert graph.relay.results[-1] == ("the next goal", GoalStatus.SUCCEEDED)


GoalLife.TestCase.settings = settings(
    max_examples=RUNS, stateful_step_count=30, suppress_health_check=list(HealthCheck))
TestGoalLife = GoalLife.TestCase

"""The goals of an action server, under goals, cancels, resends and ends in any order, judged by actionlib's own client.
"""

import copy
import tracemalloc
import unittest.mock

import actionlib.action_client as stock
from actionlib_msgs.msg import GoalID, GoalStatusArray
from genpy import Time
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult
from tracked_goals import Server

from mbf_relay.ros.common.actions import goal_lease
from mbf_relay.ros.common.actions.goal_tracker import (
    ACTIVE,
    LIST_AT_MOST,
    LIST_FOR,
    LONGEST_ID,
    PENDING,
    PREEMPTING,
    RECALLED,
    RECALLING,
    REMEMBER_AT_MOST,
    REMEMBER_FOR,
    TERMINAL,
    TRANSITIONS,
)

FOLLOWS = {state: {after for way in TRANSITIONS.values() for before, after in way.items() if before == state}
           for state in range(9)}
"""The states that may come after each one."""


def test_a_goal_recalled_is_not_begun_anew_by_another_cancel_and_its_goal_again():
    server = Server()
    server.tracker.take_cancel(GoalID(id="a"))
    assert server.state("a") == RECALLING
    server.goal("a")
    for _ in range(2):
        server.tracker.take_cancel(GoalID(id="a"))
        assert server.state("a") == RECALLED
        server.goal("a")
    assert [status.status for status in server.results] == [RECALLED] and server.taken == []


def test_a_goal_whose_cancel_came_first_is_told_of_before_it_ends():
    server, told = Server(), []
    server.on_overtaken = lambda goal: told.append((goal.get_goal_id().id, goal.get_goal(), server.state("a")))
    server.tracker.take_cancel(GoalID(id="a"))
    assert told == []
    server.goal("a")
    server.goal("a")
    assert told == [("a", "goal", RECALLING)] and server.state("a") == RECALLED


def test_a_client_hears_of_its_goal_once_it_knows_that_it_has_sent_it():
    """Of 600 goals refused at once, three never ended for rospy's SimpleActionClient, which had dropped the result."""
    server, told = Server(held_back_for=0.05), []
    server.on_status = lambda: told.append(1)
    refused, driven = server.goal("refused"), server.goal("driven")
    driven.set_accepted()
    driven.publish_feedback("here")
    refused.set_rejected()
    server.tracker.update()
    assert (server.results, server.feedback, server.tracker.listed(), told) == ([], [], [], [])
    server.wait(0.1)
    assert [status.goal_id.id for status in server.results] == ["refused"] and told
    driven.publish_feedback("there")
    assert server.feedback == ["driven"] * 2
    assert server.state("driven") == ACTIVE and server.state("refused") is not None
    driven.set_succeeded()
    assert [status.goal_id.id for status in server.results] == ["refused", "driven"], "from then on at once"


def test_a_goal_that_is_leased_or_whose_cancel_came_before_it_is_spoken_of_at_once_and_all_are_by_a_server_that_ends():
    server = Server(held_back_for=0.05)
    leased = server.goal("goal" + goal_lease.MARK)
    leased.set_rejected()
    server.tracker.take_cancel(GoalID(id="overtaken"))
    assert server.state("overtaken") == RECALLING
    server.goal("overtaken")
    assert server.state("overtaken") == RECALLED
    server.goal("new").set_rejected()
    assert [status.goal_id.id for status in server.results] == ["goal" + goal_lease.MARK, "overtaken"]
    server.tracker.release()
    assert server.results[-1].goal_id.id == "new" and server.state("new") is not None


def test_goals_of_a_busy_server_stay_in_the_status_until_slow_clients_have_their_results():
    server = Server()
    for number in range(LIST_AT_MOST + 100):
        goal = server.goal(f"goal {number}")
        goal.set_accepted()
        goal.set_succeeded()
        if number == 500:
            server.tracker.update()
            assert server.state("goal 0") is not None
    assert [status.goal_id.id for status in server.tracker.listed()] == [
        f"goal {number}" for number in range(100, LIST_AT_MOST + 100)]
    server.now += LIST_FOR + 0.1
    assert server.tracker.listed() == []


def test_a_robot_whose_client_renews_nothing_any_more_is_called_back_within_a_second():
    server = Server()
    name = "goal" + goal_lease.MARK
    goal = server.goal(name, client="/move_base")
    goal.set_accepted()
    server.wait(5.0, renew=[name])
    assert server.state(name) == ACTIVE
    server.wait(0.8)
    assert server.state(name) == PREEMPTING and server.cancelled == [goal]
    assert "/move_base" in goal.lapse and "0.5 s" in goal.lapse


def test_a_client_that_is_gone_is_noticed_behind_goals_that_ended_or_that_nobody_renews():
    server = Server()
    server.goal("ended").set_rejected()
    server.tracker.take_cancel(GoalID(id="never came"))
    server.goal("of a shell").set_accepted()
    leased = server.goal("goal" + goal_lease.MARK)
    leased.set_accepted()
    server.wait(1.0)
    assert server.cancelled == [leased]


def test_a_goal_whose_cancel_came_long_before_it_is_another_by_the_same_name():
    server = Server()
    server.tracker.take_cancel(GoalID(id="a"))
    server.wait(REMEMBER_FOR + 1.0)
    assert server.goal("a") is not None


def test_a_server_that_was_stopped_itself_does_not_hold_it_against_its_clients():
    server = Server()
    server.goal("goal" + goal_lease.MARK).set_accepted()
    server.now += 30.0
    server.tracker.update()
    assert server.cancelled == []


def test_a_robot_does_not_stop_because_its_server_found_no_time_to_read_the_renewals_that_had_come():
    server = Server()
    name = "goal" + goal_lease.MARK
    server.goal(name).set_accepted()
    for _ in range(5):
        for _ in range(2):
            server.now += 0.4
            server.tracker.update()
        server.tracker.renew(name)
    assert server.cancelled == []
    for _ in range(3):
        server.now += 0.4
        server.tracker.update()
    assert len(server.cancelled) == 1


def test_goals_of_other_clients_end_with_their_connection_only_where_that_is_asked_for():
    for client_timeout, state in ((0.0, ACTIVE), (2.0, PREEMPTING)):
        server = Server()
        server.goal("goal", client="/shell").set_accepted()
        server.wait(10.0, connected=lambda node: node == "/shell", client_timeout=client_timeout)
        assert server.state("goal") == ACTIVE
        server.wait(1.5, connected=lambda node: False, client_timeout=client_timeout)
        assert server.state("goal") == ACTIVE
        server.wait(1.0, connected=lambda node: False, client_timeout=client_timeout)
        assert server.state("goal") == state


def test_a_client_s_own_cancel_is_no_lapse():
    server = Server()
    goal = server.goal("goal" + goal_lease.MARK)
    goal.set_accepted()
    server.tracker.take_cancel(goal.get_goal_id())
    server.wait(3.0)
    assert goal.lapse == "" and len(server.cancelled) == 1


def test_cancels_by_stamp_hit_what_is_as_old_now_and_later():
    server = Server()
    old, new = server.goal("old", stamp=90.0), server.goal("new", stamp=110.0)
    server.tracker.take_cancel(GoalID(stamp=Time.from_sec(95.0)))
    assert (server.state("old"), server.state("new")) == (RECALLING, PENDING)
    late = server.goal("late", stamp=94.0)
    assert late is None and server.state("late") == RECALLED and old is not new
    assert "its timestamp is before" in server.results[-1].text
    server.now = 20.0  # a simulation was begun anew
    assert server.goal("anew", stamp=19.0) is not None


def test_a_cancel_up_to_the_moment_a_goal_was_sent_leaves_no_robot_driving():
    """A simulation's clock stands for 33 ms: the goal and the cancel that follows it are of one time."""
    server = Server()
    server.goal("before", stamp=95.0)
    server.tracker.take_cancel(GoalID(stamp=Time.from_sec(95.0)))
    assert server.state("before") == RECALLING
    assert server.goal("overtaken", stamp=95.0) is None and server.state("overtaken") == RECALLED


def test_a_cancel_ends_the_goal_it_names_and_nobody_else_s_and_one_that_names_none_ends_all():
    server = Server()
    goals = {name: server.goal(name) for name in "abc"}
    for goal in goals.values():
        goal.set_accepted()
    server.tracker.take_cancel(GoalID(id="b"))
    assert server.cancelled == [goals["b"]]
    server.tracker.take_cancel(GoalID())
    assert server.cancelled == [goals[name] for name in "bac"]
    assert {status.goal_id.id for status in server.tracker.listed()} == set("abc")


def test_a_robot_takes_the_goal_of_a_client_that_has_no_clock_yet():
    server = Server()
    server.now = 0.0
    server.goal("first", stamp=0.0)
    server.tracker.take_cancel(GoalID(id="another's"))
    assert len(server.taken) == 1 and not server.results and not server.cancelled


def test_a_goal_whose_name_is_megabytes_does_not_fill_the_memory_of_the_robot(caplog):
    server = Server()
    running = server.goal("a", client="a client")
    assert server.goal("b" * 5000000) is None
    server.tracker.take_cancel(GoalID(id="c" * 5000000))
    assert sum(len(status.goal_id.id) for status in server.tracker.listed()) == 1
    assert not running.has_ended and not server.cancelled
    assert all(len(record.getMessage()) < 200 for record in caplog.records)
    assert server.goal("d" * LONGEST_ID) is not None


def test_a_robot_that_a_crowd_of_clients_has_left_holds_little_of_their_goals():
    """The states of 2000 goals, kept a minute lest one begins anew, were most of what a relay grew by."""
    server = Server()
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for number in range(REMEMBER_AT_MOST):
            goal = server.goal(f"client-{number}")
            goal.set_accepted()
            goal.set_succeeded()
            if number % 100 == 0:  # a look goes through all that are listed
                server.tracker.update()
        del goal
        server.wait(LIST_FOR + 1.0)
        for heard in (server.taken, server.results):
            heard.clear()
        assert tracemalloc.get_traced_memory()[0] - before < 300 * REMEMBER_AT_MOST
    finally:
        tracemalloc.stop()
    server.goal("client-7")
    server.tracker.take_cancel(GoalID(id="client-8"))
    assert not server.taken and not server.results and not server.tracker.listed(), "it began anew"


def test_goals_without_a_name_are_told_apart():
    server = Server()
    server.tracker.take_goal(GoalID(), "goal"), server.tracker.take_goal(GoalID(), "goal")
    assert len({goal.get_goal_id().id for goal in server.taken}) == 2


class Judge:
    """actionlib's client state machine for one goal; complains of what actionlib calls invalid."""

    def __init__(self, name):
        self.machine = stock.CommStateMachine(MoveBaseActionGoal(goal_id=GoalID(id=name)), None, None, None, None)

    def hear_status(self, statuses):
        self.machine.update_status(GoalStatusArray(status_list=copy.deepcopy(statuses)))

    def hear_result(self, status):
        self.machine.update_result(MoveBaseActionResult(status=status))


def test_a_client_that_calls_its_goal_off_at_once_does_not_take_it_for_lost():
    """Of 40 goals of a C++ client, called off within 0.18 s, five were LOST: the status said nothing of them yet."""
    server, judge = Server(held_back_for=0.05), Judge("a")
    goal = server.goal("a")
    goal.set_accepted()
    judge.machine.state = stock.CommState.WAITING_FOR_CANCEL_ACK
    server.tracker.take_cancel(GoalID(id="a"))
    judge.hear_status(server.tracker.listed())
    assert judge.machine.state == stock.CommState.PREEMPTING
    goal.set_canceled()
    judge.hear_result(server.results[-1])
    assert judge.machine.state == stock.CommState.DONE
    assert judge.machine.latest_goal_status.status == stock.GoalStatus.PREEMPTED


class TrackerMachine(RuleBasedStateMachine):
    """Clients and an application that do as they please."""

    def __init__(self):
        super().__init__()
        self.server, self.states, self.judges, self.sent = Server(), {}, {}, []
        self.server.on_status = self.look_at_status
        self.heard = 0
        self.complaints = []
        self.patch = unittest.mock.patch.object(
            stock.rospy, "logerr", lambda text, *words: self.complaints.append(text % words if words else text)
        )
        self.patch.start()

    def teardown(self):
        self.patch.stop()

    def look_at_status(self):
        for status in self.server.tracker.listed():
            name, before = status.goal_id.id, self.states.get(status.goal_id.id)
            assert before in (None, status.status) or status.status in FOLLOWS[before], (
                f"{name}: {before} to {status.status}"
            )
            self.states[name] = status.status

    @rule(name=st.sampled_from("abcdef"), stamp=st.sampled_from([None, None, 0.0, 95.0, 1e6]))
    def goal_or_the_same_again(self, name, stamp):
        if name not in self.judges:
            self.judges[name] = Judge(name)
        self.server.goal(name, stamp=stamp)

    @rule(name=st.sampled_from("abcdefgh"), stamp=st.sampled_from([0.0, 0.0, 0.0, 95.0]))
    def cancel(self, name, stamp):
        self.server.tracker.take_cancel(GoalID(Time.from_sec(stamp), name))

    @rule(stamp=st.sampled_from([0.0, 50.0, 99.0, 100.0]))
    def cancel_many(self, stamp):
        self.server.tracker.take_cancel(GoalID(stamp=Time.from_sec(stamp)))

    @precondition(lambda self: self.server.taken)
    @rule(
        data=st.data(),
        what=st.sampled_from(["accepted", "accepted", "accepted", "rejected", "canceled", "aborted", "succeeded"]),
    )
    def application(self, data, what):
        goal = data.draw(st.sampled_from(self.server.taken))
        ended = goal.has_ended
        getattr(goal, f"set_{what}")(text=what)
        if ended:
            assert goal.status.text != what or self.states[goal.get_goal_id().id] in TERMINAL

    @precondition(lambda self: self.server.taken)
    @rule(data=st.data())
    def feedback(self, data):
        goal = data.draw(st.sampled_from(self.server.taken))
        count = len(self.server.feedback)
        goal.publish_feedback(None)
        assert len(self.server.feedback) == count + int(not goal.has_ended)

    @rule()
    def the_status_arrives(self):
        for judge in self.judges.values():
            judge.hear_status(self.server.tracker.listed())

    @rule()
    def results_arrive(self):
        for status in self.server.results[self.heard:]:
            if status.goal_id.id in self.judges:
                self.judges[status.goal_id.id].hear_result(status)
        self.heard = len(self.server.results)

    @rule(seconds=st.sampled_from([0.1, 1.0]))
    def time_passes(self, seconds):
        # what is forgotten may come again, and is another goal then
        if self.server.now + seconds < 100.0 + REMEMBER_FOR:
            self.server.wait(seconds)

    @invariant()
    def each_goal_has_one_result_which_is_its_last_state(self):
        names = [status.goal_id.id for status in self.server.results]
        assert len(names) == len(set(names))
        for status in self.server.results:
            assert self.states[status.goal_id.id] == status.status and status.status in TERMINAL
        assert {goal.get_goal_id().id for goal in self.server.taken if goal.has_ended} <= set(names)

    @invariant()
    def the_application_hears_of_each_goal_and_of_each_cancel_once(self):
        for heard in (self.server.taken, self.server.cancelled):
            assert len({goal.get_goal_id().id for goal in heard}) == len(heard)

    @invariant()
    def actionlib_s_client_finds_nothing_to_complain_of(self):
        assert self.complaints == []
        for name, judge in self.judges.items():
            lost = judge.machine.latest_goal_status.status == stock.GoalStatus.LOST
            assert not lost, f"{name} is lost to its client"


TrackerMachine.TestCase.settings = settings(max_examples=200, stateful_step_count=40)
TestTracker = TrackerMachine.TestCase

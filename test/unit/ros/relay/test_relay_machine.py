"""The relay's core under every event in any order."""

import math

from fake_server import ABORTED, ACTIVE, LOST, PREEMPTED, PREEMPTING, RECALLED, REJECTED, SUCCEEDED, Setup
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule
from mbf_msgs.msg import ExePathResult, GetPathResult, MoveBaseResult

from mbf_relay.ros.relay.relay import SUCCESSOR_PATIENCE

ENDINGS = st.sampled_from([
    (SUCCEEDED, MoveBaseResult.SUCCESS), (SUCCEEDED, ExePathResult.COLLISION), (ABORTED, GetPathResult.NO_PATH_FOUND),
    (ABORTED, ExePathResult.PAT_EXCEEDED), (ABORTED, MoveBaseResult.SUCCESS), (ABORTED, None), (LOST, None),
    (PREEMPTED, MoveBaseResult.CANCELED), (PREEMPTED, ExePathResult.INVALID_PLUGIN), (RECALLED, MoveBaseResult.SUCCESS),
    (REJECTED, GetPathResult.INVALID_PLUGIN),
])
QUATERNIONS = st.sampled_from([(0.0, 0.0, 0.0, 1.0)] * 3 + [(0.0, 0.0, 0.0, 0.0), (float("nan"), 0.0, 0.0, 1.0)])


def is_nonsense(goal):
    return math.isnan(goal.get_goal().target_pose.pose.orientation.x)


class RelayMachine(RuleBasedStateMachine):
    """Clients, a server and a clock that do as they please; stand-ins refuse what actionlib would refuse."""

    def __init__(self):
        super().__init__()
        self.setup, self.goals, self.ros_now = Setup(), [], 50.0

    @rule(age=st.sampled_from([0.0, 0.0, 0.0, 1.0, -5.0]), quaternion=QUATERNIONS)
    def goal(self, age, quaternion):
        self.goals.append(
            self.setup.goal(stamp=max(0.1, self.ros_now - age), ros_now=self.ros_now, quaternion=quaternion)
        )

    @precondition(lambda self: self.goals)
    @rule(data=st.data())
    def cancel(self, data):
        self.setup.cancel(data.draw(st.sampled_from(self.goals)))

    @precondition(lambda self: [goal for goal in self.goals if goal.is_done])
    @rule(data=st.data())
    def late_cancel(self, data):
        self.setup.relay.take_cancel(data.draw(st.sampled_from([goal for goal in self.goals if goal.is_done])))

    @precondition(lambda self: self.setup.server.sent)
    @rule(data=st.data())
    def feedback(self, data):
        data.draw(st.sampled_from(self.setup.server.sent)).say(1.0)

    @precondition(lambda self: self.setup.server.running)
    @rule(data=st.data(), ending=ENDINGS)
    def end(self, data, ending):
        data.draw(st.sampled_from(self.setup.server.running)).end(*ending)

    @rule()
    def server_dies(self):
        wanted, stops = [goal for goal in self.setup.server.running if not goal.cancels], self.setup.observer.stops
        self.setup.server.die()
        assert self.setup.observer.stops - stops == 1 or not wanted

    @rule()
    def server_comes(self):
        self.setup.server.server_is_up = True

    @rule(up=st.booleans())
    def connection_wavers(self, up):
        self.setup.server.server_is_up = up

    @rule(seconds=st.sampled_from([0.1, 0.5, 1.1, 2.5, 25.0]))
    def time_passes(self, seconds):
        self.setup.wait(seconds)
        self.ros_now += seconds

    @rule()
    def clock_set_back(self):
        self.ros_now = 1.0

    @invariant()
    def at_most_one_goal_is_pursued(self):
        open_goals = [goal for goal in self.goals if not goal.is_done]
        assert len(open_goals) <= 1
        assert bool(open_goals) == self.setup.relay.is_pursuing
        taken = [goal for goal in self.goals if goal.state != RECALLED and not is_nonsense(goal)]
        assert open_goals in ([], taken[-1:])

    @invariant()
    def each_goal_is_told_of_once(self):
        told = [name for name, *_ in self.setup.observer.ended]
        done = [goal.get_goal_id().id for goal in self.goals if goal.is_done and goal.state != RECALLED]
        assert sorted(told) == sorted(done)

    @invariant()
    def the_server_never_drives_for_nobody(self):
        if not self.setup.relay.is_pursuing:
            assert all(goal.cancels for goal in self.setup.server.running)

    @invariant()
    def a_cancelled_robot_has_nothing_left_that_drives_it(self):
        if any(goal.state == PREEMPTING for goal in self.goals):
            assert all(goal.cancels for goal in self.setup.server.running)

    @invariant()
    def the_robot_was_told_to_stand_after_the_last_goal_at_the_server(self):
        ends = [goal.ended_at for goal in self.setup.server.sent if goal.ended]
        if ends and not self.setup.server.running:
            assert self.setup.observer.stopped_at >= max(ends)

    @invariant()
    def a_goal_nobody_cancelled_is_not_cancelled_at_the_server(self):
        if self.setup.relay.is_pursuing and self.setup.server.sent:
            goal, back = next(goal for goal in self.goals if not goal.is_done), self.setup.server.sent[-1]
            if back.goal is goal.get_goal().target_pose and goal.state == ACTIVE:
                assert back.cancels == 0

    @invariant()
    def nobody_is_told_to_have_arrived_who_has_not(self):
        for goal in self.goals:
            assert (goal.state == SUCCEEDED) == (goal.text == "Goal reached.")

    def teardown(self):
        """Whatever happened, a patient and honest server brings every goal to its end."""
        server = self.setup.server
        server.server_is_up = True
        for _ in range(3):
            self.setup.wait(SUCCESSOR_PATIENCE + 0.1)
            for goal in server.running:
                goal.end(SUCCEEDED, MoveBaseResult.SUCCESS)
        assert all(goal.is_done for goal in self.goals)
        self.goals.append(self.setup.goal(stamp=1e6, ros_now=1e6))
        server.sent[-1].end(SUCCEEDED, MoveBaseResult.SUCCESS)
        assert self.goals[-1].state == SUCCEEDED


RelayMachine.TestCase.settings = settings(max_examples=150, stateful_step_count=40, deadline=None)
TestRelay = RelayMachine.TestCase

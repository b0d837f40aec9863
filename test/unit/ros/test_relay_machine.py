"""The relay's core under every event in any order."""

import pytest

pytest.importorskip("mbf_msgs.msg")

from hypothesis import settings, strategies as st  # noqa: E402
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule  # noqa: E402
from mbf_msgs.msg import ExePathResult, GetPathResult, MoveBaseResult  # noqa: E402

from fake_server import ABORTED, ACTIVE, LOST, PREEMPTED, RECALLED, REJECTED, SUCCEEDED, Setup  # noqa: E402
from mbf_relay.ros.relay import SUCCESSOR_PATIENCE  # noqa: E402

ENDINGS = st.sampled_from([
    (SUCCEEDED, MoveBaseResult.SUCCESS), (SUCCEEDED, ExePathResult.COLLISION), (ABORTED, GetPathResult.NO_PATH_FOUND),
    (ABORTED, ExePathResult.PAT_EXCEEDED), (ABORTED, MoveBaseResult.SUCCESS), (ABORTED, None), (LOST, None),
    (PREEMPTED, MoveBaseResult.CANCELED), (PREEMPTED, ExePathResult.INVALID_PLUGIN), (RECALLED, MoveBaseResult.SUCCESS),
    (REJECTED, GetPathResult.INVALID_PLUGIN),
])
QUATERNIONS = st.sampled_from([(0.0, 0.0, 0.0, 1.0)] * 3 + [(0.0, 0.0, 0.0, 0.0), (float("nan"), 0.0, 0.0, 1.0)])


class RelayMachine(RuleBasedStateMachine):
    """Clients, a server and a clock that do as they please; stand-ins refuse what actionlib would refuse."""

    def __init__(self):
        super().__init__()
        self.setup, self.fronts, self.ros_now = Setup(), [], 50.0

    @rule(age=st.sampled_from([0.0, 0.0, 0.0, 1.0, -5.0]), quaternion=QUATERNIONS)
    def goal(self, age, quaternion):
        self.fronts.append(self.setup.goal(stamp=max(0.1, self.ros_now - age), ros_now=self.ros_now, quaternion=quaternion))

    @precondition(lambda self: self.fronts)
    @rule(data=st.data())
    def cancel(self, data):
        self.setup.cancel(data.draw(st.sampled_from(self.fronts)))

    @precondition(lambda self: [front for front in self.fronts if front.is_done])
    @rule(data=st.data())
    def late_cancel(self, data):
        self.setup.relay.take_cancel(data.draw(st.sampled_from([front for front in self.fronts if front.is_done])))

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
        running, stops = bool(self.setup.server.running), self.setup.effects.stops
        last = self.setup.server.sent[-1] if self.setup.server.sent else None
        was_driving = running and not last.ended
        self.setup.server.die()
        assert self.setup.effects.stops - stops == (1 if was_driving else 0)

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
        open_fronts = [front for front in self.fronts if not front.is_done]
        assert len(open_fronts) <= 1
        assert bool(open_fronts) == self.setup.relay.is_pursuing
        assert open_fronts in ([], self.fronts[-1:]) or self.fronts[-1].state == RECALLED

    @invariant()
    def each_goal_is_told_of_once(self):
        told = [name for name, _ in self.setup.effects.ended]
        done = [front.get_goal_id().id for front in self.fronts if front.is_done and front.state != RECALLED]
        assert sorted(told) == sorted(done)

    @invariant()
    def the_server_never_drives_for_nobody(self):
        server = self.setup.server
        if not self.setup.relay.is_pursuing and server.sent and not server.sent[-1].ended:
            assert server.sent[-1].cancels >= 1

    @invariant()
    def a_goal_nobody_cancelled_is_not_cancelled_at_the_server(self):
        if self.setup.relay.is_pursuing and self.setup.server.sent:
            front, back = next(front for front in self.fronts if not front.is_done), self.setup.server.sent[-1]
            if back.goal is front.get_goal().target_pose and front.state == ACTIVE:
                assert back.cancels == 0

    @invariant()
    def no_goal_is_sent_behind_a_cancel_that_may_hit_it(self):
        for before, after in zip(self.setup.server.sent, self.setup.server.sent[1:]):
            if before.cancelled_at is not None and before.ended_at is None:
                assert after.sent_at - before.cancelled_at >= SUCCESSOR_PATIENCE

    @invariant()
    def nobody_is_told_to_have_arrived_who_has_not(self):
        for front in self.fronts:
            assert (front.state == SUCCEEDED) == (front.text == "Goal reached.")

    def teardown(self):
        """Whatever happened, a patient and honest server brings every goal to its end."""
        server = self.setup.server
        server.server_is_up = True
        for _ in range(3):
            self.setup.wait(SUCCESSOR_PATIENCE + 0.1)
            for goal in server.running:
                goal.end(SUCCEEDED, MoveBaseResult.SUCCESS)
        assert all(front.is_done for front in self.fronts)
        self.fronts.append(self.setup.goal(stamp=1e6, ros_now=1e6))
        server.sent[-1].end(SUCCEEDED, MoveBaseResult.SUCCESS)
        assert self.fronts[-1].state == SUCCEEDED


RelayMachine.TestCase.settings = settings(max_examples=150, stateful_step_count=40, deadline=None)
TestRelay = RelayMachine.TestCase

"""Stand-ins for both sides of the relay: clients' goal handles that obey actionlib's rules, and a server on a string.
"""

from actionlib_msgs.msg import GoalID
from geometry_msgs.msg import PoseStamped
from mbf_msgs.msg import MoveBaseFeedback, MoveBaseResult
from move_base_msgs.msg import MoveBaseGoal
from rospy import Time

from mbf_relay.ros.common.actions.client_goals import ActionEnding
from mbf_relay.ros.relay.relay import SUCCESSOR_PATIENCE, Observer, Relay, RelayParameters

PENDING, ACTIVE, PREEMPTED, SUCCEEDED, ABORTED, REJECTED, PREEMPTING, RECALLING, RECALLED, LOST = range(10)
TERMINAL = (PREEMPTED, SUCCEEDED, ABORTED, REJECTED, RECALLED, LOST)


class PaperClientGoal:
    """What a client sees of its goal; refuses the transitions that actionlib refuses."""

    def __init__(self, goal_id, stamp=1.0, x=0.0, quaternion=(0.0, 0.0, 0.0, 1.0)):
        self.states, self.text, self.feedback = [PENDING], "", []
        self._id = GoalID(Time.from_sec(stamp), goal_id)
        pose = PoseStamped()
        pose.header.frame_id, pose.pose.position.x = "map", x
        q = pose.pose.orientation
        q.x, q.y, q.z, q.w = quaternion
        self._goal = MoveBaseGoal(pose)

    @property
    def state(self):
        return self.states[-1]

    @property
    def is_done(self):
        return self.state in TERMINAL

    def get_goal(self):
        return self._goal

    def get_goal_id(self):
        return self._id

    def publish_feedback(self, feedback):
        assert not self.is_done, "feedback for a goal that has ended"
        self.feedback.append(feedback.base_position)

    def request_cancel(self):
        """What the action server does before it tells of a cancel; True where it tells."""
        wanted = {PENDING: RECALLING, ACTIVE: PREEMPTING}.get(self.state)
        if wanted is not None:
            self.states.append(wanted)
        return wanted is not None

    def set_accepted(self, text=""):
        self._go({PENDING: ACTIVE, RECALLING: PREEMPTING}, text)

    def set_canceled(self, result=None, text=""):
        self._go({PENDING: RECALLED, RECALLING: RECALLED, ACTIVE: PREEMPTED, PREEMPTING: PREEMPTED}, text)

    def set_aborted(self, result=None, text=""):
        self._go({ACTIVE: ABORTED, PREEMPTING: ABORTED}, text)

    def set_succeeded(self, result=None, text=""):
        self._go({ACTIVE: SUCCEEDED, PREEMPTING: SUCCEEDED}, text)

    def _go(self, allowed, text):
        assert self.state in allowed, f"from state {self.state} to one of {sorted(allowed.values())}"
        self.states.append(allowed[self.state])
        self.text = text


class FakeServer:
    """An ActionClient whose server does nothing by itself."""

    def __init__(self, clock):
        self.server_is_up, self.sent, self._clock = True, [], clock

    def send(self, goal, on_feedback, on_end):
        assert self.server_is_up
        for goal in self.running:
            late = goal.cancelled_at is not None and self._clock() - goal.cancelled_at < SUCCESSOR_PATIENCE
            assert not late, "sent behind a cancel that may hit it"
        self.sent.append(PaperServerGoal(goal, on_feedback, on_end, self._clock))
        return self.sent[-1]

    @property
    def running(self):
        return [goal for goal in self.sent if not goal.ended]

    def die(self):
        self.server_is_up = False
        for goal in self.running:
            goal.end(LOST, text="action server died")


class PaperServerGoal:
    """A goal at the server."""

    def __init__(self, goal, on_feedback, on_end, clock):
        self.goal, self._on_feedback, self._on_end, self._clock = goal, on_feedback, on_end, clock
        self.cancels, self.sent_at, self.cancelled_at, self.ended_at = 0, clock(), None, None

    @property
    def ended(self):
        return self.ended_at is not None

    def cancel(self):
        assert not self.ended, "cancel of a goal that has ended at the server"
        self.cancels += 1
        self.cancelled_at = self._clock()

    def say(self, x):
        feedback = MoveBaseFeedback()
        feedback.current_pose.pose.position.x = x
        self._on_feedback(feedback)

    def end(self, status, outcome=None, text="", message=""):
        self.end_with(status, None if outcome is None else MoveBaseResult(outcome=outcome, message=message), text)

    def end_with(self, status, result, text=""):
        self.ended_at = self._clock()
        self._on_end(ActionEnding(status, text, result))


class Recorder(Observer):
    """Remembers what the relay does."""

    def __init__(self, clock):
        self.taken, self.ended, self.stops, self.stopped_at, self._clock = [], [], 0, None, clock

    def goal_taken(self, pose):
        self.taken.append(pose)

    def goal_ended(self, client_goal, answer, result):
        self.ended.append((client_goal.get_goal_id().id, answer, result))

    def stop_robot(self):
        self.stops, self.stopped_at = self.stops + 1, self._clock()


class Setup:
    """A relay between the two, on a clock of its own."""

    def __init__(self, **parameters):
        self.now, self.observer = 100.0, Recorder(lambda: self.now)
        self.server = FakeServer(lambda: self.now)
        self.relay = Relay(
            self.server, lambda pose: pose, RelayParameters(**parameters), self.observer, clock=lambda: self.now
        )
        self.count = 0

    def goal(self, stamp=None, ros_now=1e6, **details):
        """Have a client send a goal."""
        self.count += 1
        goal = PaperClientGoal(f"g{self.count}", float(self.count) if stamp is None else stamp, **details)
        self.relay.take_goal(goal, ros_now)
        return goal

    def cancel(self, goal):
        """Have a client cancel one."""
        if goal.request_cancel():
            self.relay.take_cancel(goal)

    def wait(self, seconds):
        """Let wall time pass."""
        self.now += seconds
        self.relay.check()

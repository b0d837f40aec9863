"""A goal tracker, what it sent, and a clock."""

import copy

from actionlib_msgs.msg import GoalID
from genpy import Time
from move_base_msgs.msg import MoveBaseResult

from mbf_relay.ros.common.actions.goal_tracker import GoalTracker


class Server:
    """A tracker, what it sent, and a clock."""

    def __init__(self, held_back_for=0.0):
        self.now, self.taken, self.cancelled, self.results, self.feedback = 100.0, [], [], [], []
        self.on_status, self.on_overtaken = lambda: None, lambda goal: None
        self.tracker = GoalTracker(
            self,
            self.taken.append,
            self.cancelled.append,
            MoveBaseResult,
            lambda: self.now,
            lambda: Time.from_sec(self.now),
            on_overtaken=lambda goal: self.on_overtaken(goal),
            held_back_for=held_back_for,
        )

    def publish_result(self, status, result):
        self.results.append(copy.deepcopy(status))

    def publish_feedback(self, status, feedback):
        self.feedback.append(status.goal_id.id)

    def status_changed(self):
        self.on_status()

    def goal(self, name, client="client", stamp=None):
        self.tracker.take_goal(GoalID(Time.from_sec(self.now if stamp is None else stamp), name), "goal", client)
        return next((goal for goal in reversed(self.taken) if goal.get_goal_id().id == name), None)

    def wait(self, seconds, renew=(), connected=None, client_timeout=0.0):
        end = self.now + seconds
        while self.now < end - 1e-9:
            self.now += 0.1
            for name in renew:
                self.tracker.renew(name)
            self.tracker.update(connected, client_timeout)

    def state(self, name):
        return next((status.status for status in self.tracker.listed() if status.goal_id.id == name), None)

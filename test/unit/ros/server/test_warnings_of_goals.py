"""What the log tells an operator of a goal that does not come on, whose client is move_base's and hears nothing."""

import sys
from pathlib import Path

import pytest
from actionlib_msgs.msg import GoalID
from genpy import Time
from geometry_msgs.msg import PoseStamped
from mbf_msgs.msg import ExePathGoal, MoveBaseGoal

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "navigation"))

import scripted
from scripted_bench import Bench
from test_goals_that_cannot_begin import Answers

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.outcomes import RecoveryError, RecoveryOutcome
from mbf_relay.ros.common.throttled_warnings import PERIOD, ThrottledWarnings
from mbf_relay.ros.server.actions import make_actions
from mbf_relay.ros.server.topics import NavigationTopics


class Log:
    """A robot that drives to a goal, with its log."""

    def __init__(self, **parameters):
        self.bench = Bench(controller_patience=60.0, cmd_vel_ignored_tolerance=0.0, planner_frequency=5.0, **parameters)
        self.actions = make_actions(self.bench.navigator, Answers, lambda: Time(1000))
        self.said = []
        for action in self.actions:
            action._warnings = ThrottledWarnings(lambda: self.bench.now, lambda _, text: self.said.append(text))
            action._warnings.worked()
        goal = PoseStamped()
        goal.header.frame_id, goal.pose.position.x, goal.pose.orientation.w = "map", 90.0, 1.0
        self.actions[-1].server.take_goal(GoalID(id="drive"), MoveBaseGoal(target_pose=goal), "client")
        self.after(3.0)

    def after(self, seconds):
        """Let time pass and return what was logged meanwhile."""
        self.said.clear()
        end = self.bench.now + seconds
        while self.bench.now < end:
            for action in self.actions:
                action.take_up()
            self.bench.step()
            for action in self.actions:
                action.report()
        return self.said


def test_a_robot_that_drives_says_nothing():
    log = Log()
    assert log.after(10.0) == []
    log.bench.robot.paused = True
    assert log.after(10.0) == []


@pytest.mark.parametrize("trouble, said", [
    (lambda bench: setattr(bench.script, "plan", scripted.NO_WAY),
     "move_base: replanning failed, going on along the last path: NO_PATH_FOUND: walls all around"),
    (lambda bench: setattr(bench.script, "velocity", scripted.STUCK),
     "move_base: NO_VALID_CMD: all trajectories hit something"),
    (lambda bench: setattr(bench.robot, "held", True), "move_base: Robot has stood still for "),
    (lambda bench: setattr(bench.costmaps["local"], "stale", "3.0 s old"), "move_base: NO_VALID_CMD: 3.0 s old"),
], ids=["no replan", "no velocity", "held", "no scan"])
def test_what_keeps_a_robot_from_its_goal_is_told_and_again_and_not_too_often(trouble, said):
    log = Log()
    trouble(log.bench)
    times = 3
    told = log.after(times * PERIOD - 1.0)
    assert len(told) == times and all(text.startswith(said) for text in told)


def test_a_robot_that_turns_at_its_goal_says_nothing_of_one_replan_in_vain_on_the_way():
    """Near the goal none is made any more, and the trouble of the last one went on to the end."""
    log = Log()
    log.bench.script.plan = scripted.NO_WAY
    log.after(0.5)
    log.bench.robot.pose, log.bench.script.velocity = Pose2D(89.95, 0.0, 0.0), Twist2D(0.0, 0.0, 0.5)
    assert log.after(4.0) == []


def test_a_robot_that_drives_on_by_a_new_path_after_a_recovery_says_nothing_of_a_replan_before():
    """It was to go on along the last path, until the next replan: for 5 s at 0.2 Hz."""
    log = Log(controller_max_retries=0)
    log.bench.navigator.parameters = log.bench.navigator.parameters.replace(planner_frequency=0.2)
    log.bench.script.plan = scripted.NO_WAY
    log.after(5.5)
    log.bench.script.plan, log.bench.script.velocity = scripted.line, scripted.STUCK
    log.after(0.2)
    log.bench.script.velocity = scripted.FORWARD
    assert log.after(4.0) == []


def test_one_refused_velocity_is_no_warning_though_the_drive_before_ended_in_trouble():
    """It was taken for trouble that had lasted since."""
    log = Log()
    follow = next(action for action in log.actions if action.name == "exe_path")
    log.actions[-1].server.take_cancel(GoalID(id="drive"))
    for drive in ("ends", "goes on"):
        goal = ExePathGoal()
        goal.path.poses = [PoseStamped(), PoseStamped()]
        for pose, x in zip(goal.path.poses, (log.bench.robot.pose.x, 90.0)):
            pose.header.frame_id, pose.pose.position.x, pose.pose.orientation.w = "map", x, 1.0
        log.bench.script.velocity = scripted.STUCK
        follow.server.take_goal(GoalID(id=drive), goal, "client")
        log.after(0.5)
        if drive == "ends":
            follow.server.take_cancel(GoalID(id=drive))
            log.after(30.0)
    assert len(follow._running) == 1 and log.said == []


def test_a_recovery_that_fails_is_told_of(monkeypatch):
    """The next one began, and nobody knew that the robot had not turned."""
    said = []
    monkeypatch.setattr("rospy.Publisher", lambda *_arguments, **_options: None)
    monkeypatch.setattr("rospy.logwarn", lambda text, *values: said.append(text % values))
    log = Log(controller_max_retries=0)
    NavigationTopics(log.bench.navigator, False)
    log.bench.navigator.recovery_watcher = None
    log.bench.script.velocity = scripted.STUCK
    log.bench.script.recovery = scripted.failing(RecoveryError(RecoveryOutcome.IMPASSABLE, "'R1' cannot turn"), 1, [])
    log.after(5.0)
    assert [text for text in said if "recovery" in text] == ["recovery ended IMPASSABLE: 'R1' cannot turn"]

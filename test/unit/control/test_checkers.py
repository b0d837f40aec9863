"""Whether a goal is reached, whether one turns at it, whether it is blocked, and whether the wheels turn."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from paper import burger

from mbf_relay.control.checkers import BlockedGoalChecker, GoalChecker, StuckChecker
from mbf_relay.control.state import GoalTolerance
from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D
from mbf_relay.outcomes import ControlError, ControlOutcome

LIMITS = dict(xy_goal_tolerance=0.1, yaw_goal_tolerance=0.2, trans_stopped_vel=0.05, theta_stopped_vel=0.1)
PLAIN, LATCHED = burger(**LIMITS), burger(latch_xy_goal_tolerance=True, **LIMITS)
STANDS = Twist2D(0.0, 0.0, 0.0)


WIDE = SimpleNamespace(width=0.4)
IN_TIME = {"pose_now": None, "delay": 0.0, "period": 0.1}


def at(x, y=0.0, theta=0.0, velocity=STANDS, now=None):
    return SimpleNamespace(pose=Pose2D(x, y, theta), velocity=velocity, pose_now=now)


def turns(checker, state, parameters=PLAIN, is_occupied=False):
    return checker.update_turning(state, IDENTITY, parameters, is_occupied)


@pytest.mark.parametrize("state, expected", [
    (at(-0.11), False),  # not there
    (at(-0.09), False),  # there, and what it does brings it nearer
    (at(-0.031), False),
    (at(-0.029), True),  # so near that nothing is gained
    (at(0.09), True),  # past it
    (at(0.0, 0.09), True),  # beside it
    (at(-0.02, 0.08), True),  # nearly beside it
    (at(-0.04, 0.08), False),
    (at(0.0, -0.09, 1.3), False),  # the same, its face to it
    (at(0.0, 0.09, -1.3), False),
    (at(0.0, -0.09, -1.3), True),  # and its back to it
    (at(0.0, 0.11), False),
])
def test_one_drives_on_within_tolerance_as_long_as_that_brings_it_nearer(state, expected):
    assert turns(GoalChecker(), state) is expected


def test_one_turns_as_soon_as_it_is_within_tolerance_of_a_goal_somebody_stands_on():
    assert turns(GoalChecker(), at(-0.09), is_occupied=True) and not turns(GoalChecker(), at(-0.11), is_occupied=True)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_that_turns_at_the_goal_drives_again_where_it_has_drifted_off(side):
    checker = GoalChecker()
    assert turns(checker, at(0.0, 0.0, side)) and turns(checker, at(0.14, 0.0, side)) and checker.turns
    assert not turns(checker, at(0.16, 0.0, side)) and not checker.turns
    assert turns(checker, at(0.0, 0.0, side)) and turns(checker, at(0.14, 0.0, 0.11 * side))
    assert turns(checker, at(0.09, 0.0, 0.09 * side))
    assert not turns(checker, at(0.11, 0.0, 0.09 * side)), "it has turned, and nothing else brings it there"


def test_where_the_position_is_latched_one_that_was_there_only_turns_till_the_goal_changes():
    checker = GoalChecker()
    assert turns(checker, at(0.05), LATCHED) and turns(checker, at(3.0), LATCHED)
    assert checker.is_reached(at(3.0), IDENTITY, LATCHED) and not checker.is_reached(at(3.0), IDENTITY, PLAIN)
    checker.reset()
    assert not checker.turns and not turns(checker, at(3.0), LATCHED)
    assert not checker.is_reached(at(3.0), IDENTITY, LATCHED)


def test_one_that_has_come_past_the_goal_without_turning_at_it_has_not_reached_it():
    checker = GoalChecker()
    assert not turns(checker, at(-0.09), LATCHED) and not turns(checker, at(0.3), LATCHED)
    assert not checker.is_reached(at(0.3), IDENTITY, LATCHED)


def test_the_position_is_latched_where_the_robot_is_and_not_where_it_will_be():
    checker, there, short = GoalChecker(), Pose2D(0.05, 0.0, 0.0), Pose2D(-0.5, 0.0, 0.0)
    assert turns(checker, at(0.05, now=short), LATCHED) and not turns(checker, at(0.2, now=short), LATCHED)
    assert turns(checker, at(0.05, now=there), LATCHED) and turns(checker, at(0.2, now=short), LATCHED)


@pytest.mark.parametrize("pose, velocity, expected", [
    ((0.09, 0.0, 0.19), STANDS, True),
    ((0.11, 0.0, 0.19), STANDS, False),
    ((0.0, -0.09, -0.19), STANDS, True),
    ((0.0, -0.09, -0.21), STANDS, False),
    ((0.0, 0.0, 0.21), STANDS, False),
    ((0.0, 0.0, 2.0 * math.pi - 0.1), STANDS, True),
    ((0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.09), True),
    ((0.0, 0.0, 0.0), Twist2D(0.0, 0.0, -0.11), False),
    ((0.0, 0.0, 0.0), Twist2D(0.01, 0.0, 0.0), True),
    ((0.0, 0.0, 0.0), Twist2D(-0.02, 0.0, 0.0), False),  # on its way, however slow
])
def test_a_goal_is_reached_where_the_robot_stands_within_both_tolerances(pose, velocity, expected):
    assert GoalChecker().is_reached(at(*pose, velocity=velocity), IDENTITY, PLAIN) is expected


@pytest.mark.parametrize("speed, expected", [(0.04, True), (-0.04, True), (0.06, False), (-0.06, False)])
def test_one_that_turns_at_the_goal_stands_as_soon_as_parameters_call_it_so(speed, expected):
    checker = GoalChecker()
    assert turns(checker, at(0.0))
    assert checker.is_reached(at(0.0, velocity=Twist2D(speed, 0.0, 0.0)), IDENTITY, PLAIN) is expected


def test_an_action_s_own_tolerance_holds_till_the_goal_changes():
    checker = GoalChecker()
    checker.tolerance = GoalTolerance(0.5, 1.0)
    assert checker.is_reached(at(0.4, 0.0, 0.9), IDENTITY, PLAIN)
    checker.reset()
    assert checker.tolerance_of(PLAIN) == GoalTolerance(0.1, 0.2)


@pytest.mark.parametrize("given, expected", [
    (GoalTolerance(0.5, 0.0), GoalTolerance(0.5, 0.2)), (GoalTolerance(0.0, 1.0), GoalTolerance(0.1, 1.0)),
    (GoalTolerance(0.0, 0.0), GoalTolerance(0.1, 0.2)),
])
def test_a_part_of_an_action_s_tolerance_that_nobody_filled_in_sends_no_robot_round_its_goal_for_ever(given, expected):
    checker = GoalChecker()
    checker.tolerance = given
    assert checker.tolerance_of(PLAIN) == expected


def stuck_after(moved, command, timeout=2.0, period=0.1, seconds=6.0, start=5.0):
    """Return how long (s) a robot of 0.4 m width is told a command before it counts as stuck; None for never.

    Args:
        moved: Pose after so many seconds.
        command: Velocity, or a function of the time since the start.
        timeout, period: Seconds.
        seconds: For how long it is looked.
        start: Time of the first look.
    """
    checker = StuckChecker()
    for cycle in range(int(seconds / period)):
        since = cycle * period
        state = SimpleNamespace(now=start + since, pose=moved(since), costmap=WIDE, **IN_TIME)
        try:
            checker.check(state, command(since) if callable(command) else command, timeout)
        except ControlError as error:
            assert error.outcome is ControlOutcome.ROBOT_STUCK
            return since
    return None


def stays(_):
    return IDENTITY


AHEAD, LEFT = Twist2D(0.2, 0.0, 0.0), Twist2D(0.0, 0.0, 0.5)


@pytest.mark.parametrize("command", [AHEAD, LEFT, Twist2D(-0.2, 0.0, 0.0), Twist2D(0.0, 0.0, -0.5), Twist2D(0.1, 0, 1)])
def test_one_that_stands_though_it_is_told_to_move_is_stuck_once_time_is_up(command):
    assert stuck_after(stays, command) == pytest.approx(2.0, abs=0.11)
    assert stuck_after(stays, command, timeout=4.0) == pytest.approx(4.0, abs=0.11)
    assert stuck_after(stays, command, timeout=0.0) is None


@pytest.mark.parametrize("moved, command, expected", [
    (lambda t: Pose2D(0.03 * t, 0.0, 0.0), AHEAD, None),  # a tenth of its width within the time
    (lambda t: Pose2D(0.015 * t, 0.0, 0.0), AHEAD, 2.0),
    (lambda t: Pose2D(0.0, 0.0, 0.04 * t), LEFT, None),
    (lambda t: Pose2D(0.0, 0.0, -0.04 * t), LEFT, None),
    (lambda t: Pose2D(0.0, 0.0, 0.02 * t), LEFT, 2.0),
    (lambda t: Pose2D(min(t, 1.0), 0.0, 0.0), AHEAD, 3.0),  # it has moved, and then no more
    (stays, Twist2D(0.0, 0.0, 0.0), None),
    (stays, Twist2D(0.0009, 0.0, -0.0009), None),
    (stays, Twist2D(0.02, 0.0, 0.0), 4.0),  # it must have been told to move by twice as much
    (stays, Twist2D(0.0, 0.0, 0.025), 4.0),
    (stays, lambda t: AHEAD if t % 1.0 < 0.85 else Twist2D(0.0, 0.0, 0.0), None),  # it was told to stand in between
    (lambda t: Pose2D(min(t, 1.0), 0.0, 0.0), lambda t: AHEAD if t < 1.0 else Twist2D(0.009, 0.0, 0.0), None),
    (stays, lambda t: Twist2D(0.2 if t % 2.0 < 1.0 else -0.2, 0.0, 0.0), 2.0),  # by as much as it was to come at most
    (stays, lambda t: Twist2D(0.0, 0.0, 0.2 if t % 2.0 < 1.0 else -0.2), 2.0),
])
def test_one_that_moves_by_as_much_as_it_could_be_taken_for_is_not_stuck(moved, command, expected):
    found = stuck_after(moved, command)
    assert found is expected if expected is None else found == pytest.approx(expected, abs=0.15)


def test_one_that_was_not_looked_at_for_a_second_or_before_time_was_set_back_is_not_stuck():
    assert stuck_after(stays, AHEAD, period=1.0) is None and stuck_after(stays, AHEAD, period=0.9) is not None
    checker = StuckChecker()
    for now in (5.0, 5.9, 6.8, 5.8, 6.7):
        state = SimpleNamespace(now=now, pose=IDENTITY, costmap=WIDE, **IN_TIME)
        checker.check(state, AHEAD, 1.0 if now < 6.8 else 2.0)
    checker.reset()
    checker.check(SimpleNamespace(now=7.0, pose=IDENTITY, costmap=WIDE, **IN_TIME), AHEAD, 0.1)


@pytest.mark.parametrize("command, words, is_hinted", [
    (Twist2D(0.2, 0.0, -0.5), "for 2.0 s, though 0.40 m and 1.00 rad were commanded", False),
    (LEFT, "for 2.0 s, though 0.00 m and 1.00 rad were commanded", True),  # on the spot, as no car can turn
])
def test_who_is_stuck_is_told_for_how_long_and_by_how_much_it_was_to_move(command, words, is_hinted):
    checker, told = StuckChecker(), None
    for cycle in range(40):
        state = SimpleNamespace(now=0.1 * cycle, pose=IDENTITY, costmap=WIDE, **IN_TIME)
        try:
            checker.check(state, command, 2.0)
        except ControlError as error:
            told = error.message
            break
    assert words in told and ("Ackermann" in told) is is_hinted


class Goal:
    """A goal ahead of a robot of 0.2 m width, and what stands about."""

    def __init__(self, distance=0.5, free_from=math.inf):
        self.checker, self.free_from, self.distance = BlockedGoalChecker(), free_from, distance

    def check(self, now, tolerance=0.1, is_on_map=True, **parameters):
        goal = Pose2D(self.distance, 0.0, 0.0)
        grid = SimpleNamespace(contains_point=lambda x, y: is_on_map)
        costmap = SimpleNamespace(width=0.2, inscribed_radius=0.1, grid=grid, frame="odom")
        path = SimpleNamespace(
            goal=goal, remaining=self.distance, goal_arc=3.0 + self.distance,
            point_at=lambda arc: np.array([arc - 3.0, 0.0]))
        clearance = SimpleNamespace(
            costmap=costmap, clearance_at=lambda x, y: 0.09 if x > self.distance - self.free_from else 0.1)
        state = SimpleNamespace(now=now, pose=IDENTITY, costmap=costmap)
        values = burger(max_vel_trans=0.22, max_vel_x=0.22, blocked_timeout=2.0, **parameters)
        return self.checker.check(state, path, clearance, values, tolerance)


def test_a_goal_is_blocked_once_it_has_been_so_for_a_while():
    goal = Goal()
    assert goal.check(1.0) and goal.check(2.9)
    with pytest.raises(ControlError, match=r"goal \(0.50, 0.00\) in odom; the robot is 0.50 m before it") as told:
        goal.check(3.0)
    assert told.value.outcome is ControlOutcome.BLOCKED_GOAL


def test_who_comes_onto_a_goal_anew_is_waited_for_anew():
    for meanwhile in (lambda goal: goal.checker.reset(), lambda goal: goal.check(2.5, is_on_map=False)):
        goal = Goal()
        assert goal.check(1.0)
        meanwhile(goal)
        assert goal.check(3.0) and goal.check(4.9)
    goal = Goal()
    assert goal.check(9.0) and goal.check(5.0) and goal.check(6.9), "time was set back"
    with pytest.raises(ControlError):
        goal.check(7.0)


def test_a_goal_is_not_blocked_where_the_path_is_free_as_near_as_its_tolerance_asks():
    for free_from, is_given_up in ((0.09, False), (0.11, True)):
        goal = Goal(free_from=free_from)
        assert goal.check(1.0)
        if is_given_up:
            with pytest.raises(ControlError):
                goal.check(3.0)
        else:
            assert goal.check(3.0) and goal.check(9.0), "it is told that somebody stands there"


@pytest.mark.parametrize("distance, expected", [(0.09, True), (0.89, True), (0.91, False)])
def test_a_goal_is_looked_at_from_nearby_and_not_is_given_up_within_tolerance(distance, expected):
    goal = Goal(distance)
    assert goal.check(1.0) is expected
    if distance != 0.89:
        assert goal.check(9.0) is expected


def test_a_robot_whose_goal_is_free_or_off_the_map_is_told_nothing():
    assert Goal(free_from=-0.1).check(1.0) is False and Goal().check(1.0, is_on_map=False) is False


@pytest.mark.parametrize("stands, expected", [(True, 3.0), (False, None)])
def test_a_robot_of_late_wheels_is_stuck_by_where_it_is_and_not_before_they_can_have_heard(stands, expected):
    """Where it is expected moves with each command, whether the wheels turn or not."""
    checker, stuck = StuckChecker(), None
    for cycle in range(50):
        expected_at = Pose2D(0.2 + 0.02 * cycle, 0.0, 0.0)
        here = IDENTITY if stands else expected_at
        state = SimpleNamespace(now=0.1 * cycle, pose=expected_at, pose_now=here, delay=1.0, period=0.1, costmap=WIDE)
        try:
            checker.check(state, AHEAD, 2.0)
        except ControlError:
            stuck = state.now
            break
    assert stuck == (None if expected is None else pytest.approx(expected, abs=0.11))


def test_a_robot_that_was_stuck_has_all_its_time_again():
    checker, stuck_at = StuckChecker(), []
    for cycle in range(50):
        state = SimpleNamespace(now=0.1 * cycle, pose=IDENTITY, costmap=WIDE, **IN_TIME)
        try:
            checker.check(state, AHEAD, 2.0)
        except ControlError:
            stuck_at.append(state.now)
    assert stuck_at == pytest.approx([2.0, 4.1], abs=0.11)

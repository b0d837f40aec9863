"""The dead man's switch, waypoints, and what is told of a goal."""

import numpy as np
import pytest

from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.view.dead_man import PATIENCE, DeadMan
from mbf_relay.view.story import GoalStory, length_left
from mbf_relay.view.tour import Tour

AHEAD = Twist2D(0.2, 0.0, 0.0)
A, B, C = Pose2D(0.0, 0.0, 0.0), Pose2D(1.0, 0.0, 0.0), Pose2D(1.0, 1.0, 1.0)


def test_a_hand_that_falls_silent_stops_the_robot_once():
    stick = DeadMan()
    assert stick.command(0.0) is None
    assert stick.push("one", AHEAD, 10.0)
    assert stick.command(10.0 + 0.9 * PATIENCE) == AHEAD
    assert stick.command(10.0 + PATIENCE) == STOP
    assert stick.command(11.0) is None


def test_one_hand_drives_at_a_time():
    stick = DeadMan()
    assert stick.push("one", AHEAD, 0.0)
    assert not stick.push("two", AHEAD, 0.1)
    assert stick.release("two") is None
    assert stick.release("one") == STOP
    assert stick.push("two", AHEAD, 0.2)


def test_nobody_who_lets_go_stops_nothing():
    assert DeadMan().release("one") is None
    assert DeadMan().release(None) is None


def drive(tour, now=0.0, times=10):
    goals = []
    for _ in range(times):
        goal = tour.next_goal(now)
        if goal is None:
            break
        goals.append(goal)
        assert tour.next_goal(now) is None, "a second goal before the first has ended"
        tour.reached(now)
    return goals


def test_a_list_is_driven_once_and_is_over():
    tour = Tour([A, B, C], False, 0.0)
    assert not tour.is_over
    assert drive(tour) == [A, B, C]
    assert tour.is_over


def test_a_loop_goes_round():
    tour = Tour([A, B], True, 0.0)
    assert drive(tour, times=5) == [A, B, A, B, A]
    assert not tour.is_over


def test_it_stands_at_each_waypoint_and_not_after_the_last():
    tour = Tour([A, B], False, 5.0)
    assert tour.next_goal(0.0) == A
    tour.reached(10.0)
    assert tour.next_goal(14.9) is None
    assert tour.next_goal(15.0) == B
    assert not tour.is_over
    tour.reached(20.0)
    assert tour.is_over


def test_the_way_left_is_along_the_path_from_where_the_robot_is():
    path = np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (2.0, 3.0)])
    assert length_left(path, Pose2D(1.0, 0.5, 0.0)) == pytest.approx(0.5 + 1.0 + 3.0)
    assert length_left(path, Pose2D(2.0, 3.0, 0.0)) == pytest.approx(0.0)


def test_a_goal_is_told_from_plan_to_outcome():
    story = GoalStory()
    assert story.as_dict(None, 0.0)["state"] == "idle"
    story.began(C)
    story.planned(np.array([(0.0, 0.0), (2.0, 0.0)]), 1.0)
    story.drove(1.2)
    for tick in range(100):
        story.moves(0.5, 0.1 * tick)
    told = story.as_dict(A, 1.3)
    assert (told["state"], told["planning"], told["driving"], told["recovering"]) == ("active", True, True, "")
    assert (told["left"], told["time_left"]) == (2.0, pytest.approx(4.0, abs=0.2))
    story.recovers("rotate", 2.0)
    told = story.as_dict(A, 2.1)
    assert (told["planning"], told["recovering"]) == (False, "rotate")
    story.ended("failed", "no way")
    told = story.as_dict(A, 2.2)
    assert (told["state"], told["outcome"], told["left"], told["goal"], told["recovering"]) == (
        "failed",
        "no way",
        None,
        None,
        "",
    )


def test_a_new_goal_forgets_how_the_last_one_ended():
    story = GoalStory()
    story.began(A)
    story.ended("failed", "no way")
    story.began(B)
    assert story.as_dict(A, 0.0)["outcome"] == ""
    assert story.as_dict(A, 0.0)["goal"] == [1.0, 0.0, 0.0]


def test_a_robot_that_stands_is_told_no_time():
    story = GoalStory()
    story.began(B)
    story.planned(np.array([(0.0, 0.0), (1.0, 0.0)]), 0.0)
    story.moves(0.0, 0.0)
    assert story.as_dict(A, 0.1)["time_left"] is None

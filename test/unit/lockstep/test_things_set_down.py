"""Things that somebody sets down round a robot that drives, and takes away again: it touches none, and arrives."""

import math
import random
from pathlib import Path

import pytest

pytest.importorskip("pybullet")

from faulty_drive import FaultyDrive  # noqa: E402
from tally import how_many, trial  # noqa: E402

from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.lockstep.episode import Episode  # noqa: E402
from mbf_relay.lockstep.settings import config_folder  # noqa: E402
from mbf_relay.lockstep.setup import make_setup  # noqa: E402
from mbf_relay.lockstep.tasks import circle, task_of  # noqa: E402
from mbf_relay.simulation.shapes import Box, Cylinder  # noqa: E402
from mbf_relay.simulation.worlds_file import world_of  # noqa: E402


def in_front(robot, chance):
    """So near that the robot can just brake."""
    return [robot.compose(Pose2D(chance.uniform(0.38, 0.6), chance.uniform(-0.1, 0.1), 0.0))]


def on_the_way(robot, chance):
    """Two, farther off."""
    return [robot.compose(Pose2D(chance.uniform(0.6, 1.2), chance.uniform(-0.4, 0.4), 0.0)) for _ in range(2)]


def on_the_goal(robot, chance):
    """Where nobody can arrive any more; on the robot's own place nothing can be set."""
    goal = circle().goals[1]
    return [goal] if goal.distance_to(robot) > 0.4 else []


def all_round(robot, chance):
    """A fence that leaves no way out."""
    turned = chance.uniform(0.0, math.pi)
    around = [turned + math.pi * each / 4.0 for each in range(8)]
    return [robot.compose(Pose2D(0.45 * math.cos(angle), 0.45 * math.sin(angle), 0.0)) for angle in around]


PLACES = (in_front, on_the_way, on_the_goal, all_round)
SHAPES = ((Box((0.2, 0.2, 0.4)), 0.2), (Cylinder(0.1, 0.4), 0.2), (Cylinder(0.05, 1.0), 0.5))
"""Each with the height of its middle (m)."""

SEEN = 3.0
"""Seconds after which the costmaps have surely seen that a thing is gone."""


@pytest.mark.parametrize("index", range(how_many(4, 100)))
def test_a_robot_round_which_things_are_set_down_touches_none_and_arrives_once_they_are_gone(index):
    chance, place = random.Random(index), PLACES[index % len(PLACES)]
    drive = FaultyDrive(index)
    try:
        with trial("things set down in front, on the way, on the goal, all round"):
            assert drive.step_until(drive.is_driving, 20.0), "it never drove"
            start, metres = drive.simulation.true_pose, chance.uniform(0.0, 0.8)
            drive.step_until(lambda: drive.simulation.true_pose.distance_to(start) >= metres, 20.0)
            names = []
            for number, there in enumerate(place(drive.simulation.true_pose, chance)):
                names.append(f"thing {number}")
                shape, height = chance.choice(SHAPES)
                drive.set_down(names[-1], shape, there, height)
            drive.step_until(lambda: drive.goal.done, chance.uniform(5.0, 40.0))
            for name in names:
                drive.simulation.scene.remove_obstacle(name)
            drive.step_until(lambda: drive.goal.done, SEEN)  # it may end still for what stood there
            drive.arrive()
    finally:
        drive.close()


@pytest.mark.parametrize("radius, distance", [(0.003, 0.2), (0.003, 0.5), (0.006, 0.35)])
def test_a_rod_that_no_more_than_a_beam_or_two_hit_is_not_run_over(radius, distance):
    """What one beam alone hits counts from its second scan on, which comes soon enough."""
    drive = FaultyDrive(1, goal=0)
    try:
        assert drive.step_until(drive.is_driving, 20.0), "it never drove"
        there = drive.simulation.true_pose.compose(Pose2D(distance, 0.0, 0.0))
        drive.set_down("rod", Cylinder(radius, 0.5), there, 0.25)
        drive.arrive()
    finally:
        drive.close()


@pytest.mark.parametrize("place, goal", [
    ([0.35, 0.0, 0.0, 0.04, 0.5, 0.5], [2.0, 0.0, 0.0]),  # 4 cm before its front
    ([0.32, 0.0, 0.0, 0.02, 0.5, 0.5], [2.0, 0.0, 0.0]),
    ([0.0, 0.32, 0.0, 0.5, 0.04, 0.5], [0.0, 2.0, 1.57]),  # beside it
])
def test_a_robot_does_not_run_into_what_stands_within_its_padding(place, goal):
    """Files of a Husky or a Jackal have a padding of 0.1 m; what stood in it was taken for the robot's own."""
    world = {"name": "within the padding", "boxes": [place], "start": [0.0, 0.0, 0.0], "goal": goal, "goal_radius": 0.3,
             "time_limit": 40.0}
    changes = [f"{costmap}.footprint_padding=0.1" for costmap in ("local_costmap", "global_costmap")]
    setup = make_setup(config_folder(), robot="medium", changes=changes, has_map=False)
    result = Episode(task_of(world_of(Path("worlds"), 0, world)), setup, 1).run()
    assert result.success, (result.outcome, result.message)

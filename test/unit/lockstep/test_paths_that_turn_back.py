"""Paths of exe_path that turn back on themselves, driven by the whole stack."""

import dataclasses
import math
import sys
from pathlib import Path as File

import pytest
import small_worlds

from mbf_relay.lockstep.graph import Graph
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.lockstep.setup import make_setup
from mbf_relay.lockstep.stages import Stages
from mbf_relay.lockstep.tasks import task_of
from mbf_relay.navigation.goals import FollowGoal
from mbf_relay.simulation.worlds_file import world_of

sys.path.insert(0, str(File(__file__).parents[2]))
from kinematics import path_through  # noqa: E402

AHEAD, BACK = (1.5, 0.1), (0.0, 0.1)


def followed(corners, seconds=60.0, robot="", controller=""):
    """Return what came of a path through `corners`, and where the robot was meanwhile."""
    world = world_of(File("worlds.json"), 0, {**small_worlds.FREE, "cylinders": [], "start": [0.0, 0.1, 0.0]})
    setup = make_setup(config_folder(), has_map=False, robot=robot)
    graph = Graph(task_of(world), setup, 1, Stages(None), lambda now, velocity: None)
    try:
        path = dataclasses.replace(path_through(*corners), frame=graph.map_frame)
        task, places, end = graph.navigator.exe_path(FollowGoal(path, controller)), [], graph.now + seconds
        while not task.done and graph.now < end:
            graph.step()
            places.append(graph.simulation.true_pose[:2])
        return task, places
    finally:
        graph.close()


@pytest.mark.parametrize("controller", ["DWAPlannerROS", "MPPI"])
def test_a_path_ahead_and_back_along_the_same_line_is_driven_to_both_ends(controller):
    """A burger turned back half a metre before it, well done as it said, or stood there until it was said to oscillate.
    """
    task, places = followed((BACK, AHEAD, BACK), controller=controller)
    assert task.done, f"still at {places[-1]}"
    result = task.ended_with()
    assert result.outcome.name == "SUCCESS", result.message
    assert min(math.dist(place, AHEAD) for place in places) < 0.1 and math.dist(places[-1], BACK) < 0.1

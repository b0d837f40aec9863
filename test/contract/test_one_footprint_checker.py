"""One answer to whether the footprint touches, whoever asks: controllers, recovery behaviours, planners."""

import os
import sys

import numpy as np
import pytest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from controllers import NAMES, make  # noqa: E402
from kinematics import BURGER, path_through  # noqa: E402
from plain_footprint import contacts, random_costmap  # noqa: E402

from mbf_relay.control.follower import PathFollower  # noqa: E402
from mbf_relay.control.state import ControlState  # noqa: E402
from mbf_relay.costmap.factory import build_costmap  # noqa: E402
from mbf_relay.geometry import STOP, Pose2D  # noqa: E402
from mbf_relay.planning.passage import checker_on  # noqa: E402
from mbf_relay.recovery.maneuver import checked_pose  # noqa: E402

POSES = 10_000
LONG = np.array([[-0.3, -0.16], [-0.3, 0.16], [0.1, 0.16], [0.1, -0.16]])


class Still:
    """A live costmap that shows one snapshot, and a recovery behaviour's view of it."""

    now, frame = 0.0, "odom"

    def __init__(self, shown):
        self.shown, self.costmaps = shown, {"local": self}

    def snapshot(self):
        return self.shown

    def stale_reason(self, now):
        return None

    def pose_in(self, frame):
        return Pose2D(0.0, 0.0, 0.0)


def checkers(costmap):
    """Yield who asks and the checker they ask."""
    for name in NAMES:
        controller = make(name)
        if isinstance(controller, PathFollower):
            controller.set_path(path_through((0, 0), (1.0, 0)), True)
            yield name, controller.look_around(ControlState(0.0, Pose2D(0.0, 0.0, 0.0), STOP, costmap)).checker
    yield "recovery behaviours", checked_pose(Still(costmap), "any").checker
    yield "planners", checker_on(costmap)


@pytest.mark.parametrize("footprint", [BURGER, LONG], ids=["burger", "long"])
def test_all_who_ask_are_told_the_same_of_ten_thousand_poses(footprint):
    rng = np.random.default_rng(11)
    costmap = random_costmap(rng, obstacles=150, footprint=footprint)
    poses = rng.uniform((-1.1, -1.1, -7.0), (1.1, 1.1, 7.0), (POSES, 3))
    answers = {who: checker.touches(poses) for who, checker in checkers(costmap)}
    assert len(answers) >= 4
    first = next(iter(answers.values()))
    assert 0.2 < first.mean() < 0.98
    for who, answer in answers.items():
        assert (answer == first).all(), f"{who} differ in {(answer != first).sum()} of {POSES} poses"
    plain = [contacts(costmap, Pose2D(*pose), headings=256 if footprint is BURGER else 512) > 0 for pose in poses[:400]]
    assert (first[:400] == plain).mean() > 0.99, "a point on the edge of a cell may round either way"


def test_one_parameter_of_the_server_sets_the_overlap_of_both_costmaps():
    for name in ("global_costmap", "local_costmap"):
        assert build_costmap(name, {}, {"obstacle_overlap": 0.4}).snapshot().obstacle_overlap == 0.4
        assert build_costmap(name, {}, {}).snapshot().obstacle_overlap == 0.2
    assert build_costmap("local_costmap", {"obstacle_overlap": 0.6}, {}).snapshot().obstacle_overlap == 0.5


def test_the_default_overlap_is_within_the_default_padding():
    costmap = build_costmap("local_costmap", {}, {})
    assert (
        costmap.snapshot().obstacle_overlap * costmap.parameters.resolution
        <= costmap.parameters.footprint_padding + 1e-9
    )

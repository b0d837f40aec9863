"""The way back along which a robot came, out of gaps that it fits into and cannot turn in."""

import math
import os
import sys

import numpy as np
import pytest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "contract"))
from controllers import NAMES, make  # noqa: E402
from kinematics import PaperRobot, boxes, costmap_round, drive, path_through, touches  # noqa: E402

from mbf_relay.control.back_out import BackOut  # noqa: E402
from mbf_relay.control.local_path import PathTracker  # noqa: E402
from mbf_relay.control.state import ControlState  # noqa: E402
from mbf_relay.control.trail import Trail  # noqa: E402
from mbf_relay.costmap.footprint_checker import FootprintChecker  # noqa: E402
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D, angle_between  # noqa: E402

START, PERIOD = Pose2D(0.0, 0.0, 0.0), 0.1
POCKET = (0.8, 0.13, 1.3, 0.25), (0.8, -0.25, 1.3, -0.13), (1.12, -0.2, 1.3, 0.2)


class Gap:
    """A gap marked narrower than the robot as it passes, as a lidar marks what is beside it; behind it a dead end."""

    def __init__(self):
        self.farthest, self.is_inside = 0.0, False

    def costmap(self, pose, occupied, now):
        self.farthest = max(self.farthest, pose.x)
        seen = min(0.8, self.farthest)
        sides = ((0.4, 0.08, seen, 0.2), (0.4, -0.2, seen, -0.08)) if seen > 0.4 else ()
        return costmap_round(pose, boxes(*sides, *POCKET), size=4.0, resolution=0.025, now=now)

    def path_back(self, now, pose):
        """Lead the robot back once it is through."""
        if pose.x > 0.97 and not self.is_inside:
            self.is_inside = True
            return path_through((pose.x, 0.0), (-0.8, 0.0))
        return None


class Daring(PaperRobot):
    """Drives through a gap, whatever it is told there, and then does as it is told."""

    def __init__(self, gap):
        super().__init__(START)
        self.gap = gap

    def move(self, command, seconds, step=0.01):
        super().move(command if self.gap.is_inside else Twist2D(0.2, 0.0, 0.0), seconds, step)


@pytest.mark.parametrize("name", NAMES)
def test_one_led_back_through_a_gap_it_passed_by_a_hair_goes_as_it_came(name):
    """It fitted through, could not turn behind it, and stood there: what it had passed touching shut it in."""
    gap = Gap()
    ended = drive(
        make(name, min_vel_x=-0.22, foresight=False), path_through((0.0, 0.0), (1.03, 0.0)), START, boxes(*POCKET),
        robot=Daring(gap), patience=8.0, costmap=gap.costmap, each_cycle=gap.path_back)
    assert gap.is_inside
    assert ended.reached and not ended.contacts, (ended.error, ended.poses[-1])


def test_one_round_which_everything_is_marked_knows_the_way_it_came_or_of_none():
    """Without an arc to choose from its controller ended in an internal error."""
    tight = boxes((0.245, -0.2, 0.3, 0.2), (-2.0, 0.11, 1.0, 0.2), (-2.0, -0.2, 1.0, -0.11), (0.05, -0.2, 0.093, 0.2))
    costmap, pose = costmap_round(START, tight, resolution=0.025), Pose2D(0.2, 0.0, 0.0)
    parameters, checker, tracker = make("regulated_pure_pursuit").parameters, FootprintChecker(costmap), PathTracker()
    tracker.set_path(path_through((0.2, 0.0), (-1.0, 0.0)))
    path = tracker.cut(ControlState(0.0, pose, STOP, costmap, IDENTITY, PERIOD), 0.6, 1.0, 0.4)
    for came in False, True:
        back_out = BackOut()
        for place in held(START, (0.2, 0.0, 10)) if came else ():
            back_out.trail.note(place, checker)
        for now in (0.0, 1.0):
            back_out.failed(now, pose, path, checker, parameters)
        assert not back_out.is_active


def noted(poses, costmap):
    """Return a trail along poses on a costmap."""
    trail = Trail()
    for pose in poses:
        trail.note(pose, FootprintChecker(costmap))
    return trail


def retraced(way, pose, checker, parameters):
    """Return the poses of a robot that does as it is told, until it is told nothing."""
    poses, velocity = [pose], STOP
    while len(poses) < 1000:
        told = way.command(poses[-1], velocity, checker, parameters, PERIOD, (0.033, 0.1), parameters.max_vel_theta)
        if told is None:
            return poses
        velocity = told
        poses.append(poses[-1].compose(velocity.held(PERIOD)))
    raise AssertionError(f"it does not come to an end: {poses[-1]}")


def held(pose, *velocities):
    """Return the poses that velocities, each held for a number of periods, lead through."""
    poses = [pose]
    for x, theta, periods in velocities:
        for _ in range(periods):
            poses.append(poses[-1].compose(Twist2D(x, 0.0, theta).held(PERIOD)))
    return poses


CAME = {
    "straight": [(0.2, 0.0, 20)],
    "round a bend": [(0.2, 0.0, 10), (0.2, 1.0, 16), (0.2, 0.0, 5)],
    "in an S": [(0.2, 1.0, 10), (0.2, -1.0, 10)],
    "with a turn on the spot": [(0.2, 0.0, 10), (0.0, -1.0, 12), (0.2, 0.0, 10)],
    "to and fro": [(0.2, 0.0, 10), (-0.1, 0.8, 8), (0.1, 0.8, 8), (0.2, 0.0, 5)],
}


@pytest.mark.parametrize("came", sorted(CAME))
def test_it_goes_back_as_it_came_and_no_other_way(came):
    """It left the way it had come by where that bent, and there was no room beside it."""
    poses = held(START, *CAME[came])
    costmap, parameters = costmap_round(START, resolution=0.025), make("dwa_local_planner/DWAPlannerROS").parameters
    trail, checker = noted(poses, costmap), FootprintChecker(costmap)
    back = np.array(retraced(trail.way_back(poses[-1], checker), poses[-1], checker, parameters))
    fine = np.array(held(START, *((x / 5.0, theta / 5.0, 5 * periods) for x, theta, periods in CAME[came])))
    off = np.hypot(back[:, None, 0] - fine[None, :, 0], back[:, None, 1] - fine[None, :, 1])
    turned = np.abs((back[:, None, 2] - fine[None, :, 2] + np.pi) % (2.0 * np.pi) - np.pi)
    assert (off + 0.1 * turned).min(axis=1).max() < 0.025, "a cell"
    assert math.hypot(*back[-1, :2]) < 0.03 and abs(back[-1, 2]) < 0.1


def test_somebody_who_stepped_on_the_way_back_is_not_driven_into():
    """The way it came is known to be free only of what stood there then."""
    poses, parameters = held(START, (0.2, 0.0, 40)), make("dwa_local_planner/DWAPlannerROS").parameters
    trail = noted(poses, costmap_round(START, resolution=0.025))
    foot = boxes((0.2, 0.06, 0.3, 0.16))
    checker = FootprintChecker(costmap_round(START, foot, resolution=0.025))
    back = retraced(trail.way_back(poses[-1], checker), poses[-1], checker, parameters)
    assert 0.38 < back[-1].x < 0.46 and not any(touches(pose, foot, shrink=0.007) for pose in back)


def test_one_carried_elsewhere_has_no_way_back_through_what_lies_between():
    """It took the line between two places it had been at for a way it had driven."""
    trail = noted([*held(START, (0.2, 0.0, 10)), *held(Pose2D(0.0, 0.9, 0.0), (0.2, 0.0, 10))],
                  costmap_round(START, resolution=0.025))
    way = trail.way_back(Pose2D(0.2, 0.9, 0.0), FootprintChecker(costmap_round(START, resolution=0.025)))
    assert way.poses[:, 1].min() == pytest.approx(0.9) and way.arcs[-1] == pytest.approx(0.2, abs=0.02)


def test_a_loop_is_left_out_of_the_way_back():
    """One that had turned to and fro in a gap would have gone through all of it again on its way out."""
    poses = held(START, (0.2, 0.0, 10), (0.0, 1.0, 10), (0.0, -1.0, 10))
    costmap = costmap_round(START, resolution=0.025)
    way = noted(poses, costmap).way_back(poses[-1], FootprintChecker(costmap))
    assert way.arcs[-1] == pytest.approx(0.2, abs=0.03) and abs(angle_between(way.poses[0, 2], way.poses[-1, 2])) < 0.1

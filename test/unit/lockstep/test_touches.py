"""Contacts: whose fault they were by the simulator's truth, and drives that go on after one."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pybullet")
sys.path.insert(0, str(Path(__file__).parent))

import small_worlds  # noqa: E402

from mbf_relay.geometry import STOP, Pose2D, Twist2D  # noqa: E402
from mbf_relay.lockstep.clearance import smallest_time_to_collision  # noqa: E402
from mbf_relay.lockstep.episode import Episode  # noqa: E402
from mbf_relay.lockstep.pictures import drive_of  # noqa: E402
from mbf_relay.lockstep.record import Record  # noqa: E402
from mbf_relay.lockstep.result import EpisodeResult  # noqa: E402
from mbf_relay.lockstep.settings import config_folder  # noqa: E402
from mbf_relay.lockstep.setup import SERVER, make_setup  # noqa: E402
from mbf_relay.lockstep.tasks import EpisodeTask, load_tasks  # noqa: E402
from mbf_relay.lockstep.touches import Touches  # noqa: E402
from mbf_relay.simulation.contacts import Contact  # noqa: E402
from mbf_relay.simulation.frames import Frame  # noqa: E402
from mbf_relay.simulation.robot_file import load_robot  # noqa: E402
from mbf_relay.simulation.shapes import Body, Cylinder  # noqa: E402
from mbf_relay.simulation.world import Mover, World  # noqa: E402

AHEAD = Contact("post", (0.04, 0.0, 0.1), (-1.0, 0.0, 0.0))
FROM_BEHIND = Contact("walker", (-0.1, 0.0, 0.1), (1.0, 0.0, 0.0))
HERE = Pose2D(0.0, 0.0, 0.0)


def noted(contact, came_from, commanded=STOP, pusher=None):
    touches = Touches()
    if pusher is not None:
        touches.note(0.95, [pusher], (0.9, HERE), HERE, commanded)
    touches.note(1.0, [contact] if pusher is None else [pusher, contact], (0.9, came_from), HERE, commanded)
    return touches


def test_a_robot_that_drives_into_a_post_is_at_fault():
    touches = noted(AHEAD, Pose2D(-0.02, 0.0, 0.0))
    assert touches.times == [1.0] and touches.at_fault == 1 and touches.first == "touched post"


@pytest.mark.parametrize("speed, faults", [(0.0, 0), (-0.1, 0), (0.1, 1)])
def test_a_robot_that_is_pushed_onto_a_post_is_at_fault_where_it_drives_there_itself(speed, faults):
    touches = noted(AHEAD, Pose2D(-0.02, 0.0, 0.0), Twist2D(speed, 0.0, 0.0), FROM_BEHIND)
    assert touches.times == [0.95, 1.0] and touches.at_fault == faults


def test_a_robot_that_brakes_too_late_before_two_posts_is_at_fault_for_both():
    touches = Touches()
    touches.note(1.0, [AHEAD, AHEAD._replace(name="other")], (0.9, Pose2D(-0.02, 0.0, 0.0)), HERE, STOP)
    assert touches.times == [1.0, 1.0] and touches.at_fault == 2


@pytest.mark.parametrize("came_from", [HERE, Pose2D(-0.02, 0.0, 0.0)], ids=["standing", "driving away"])
def test_a_robot_that_is_walked_into_is_not_at_fault(came_from):
    touches = noted(FROM_BEHIND, came_from)
    assert touches.times == [1.0] and touches.at_fault == 0 and "came to the robot" in touches.first


def test_a_corner_swung_into_a_wall_is_the_robots_fault():
    beside = Contact("wall", (0.04, 0.105, 0.1), (0.0, -1.0, 0.0))
    assert noted(beside, Pose2D(0.0, 0.0, -0.1)).at_fault == 1
    assert noted(beside, Pose2D(0.0, 0.0, 0.1)).at_fault == 0


def test_a_hull_that_scrapes_along_a_wall_touches_it_once():
    touches = Touches()
    for step in range(20):
        touches.note(0.5 * step, [AHEAD], (0.5 * step - 0.1, HERE), HERE, STOP)
    assert len(touches.times) == 1
    touches.note(12.0, [AHEAD], (11.9, HERE), HERE, STOP)
    assert touches.times == [0.0, 12.0]


def test_time_to_collision_is_distance_over_closing_speed():
    times = np.array([0.0, 0.1, 0.2, 0.3])
    distances = np.array([[1.0, 0.9, 0.8, 0.85], [0.2, 0.2, 0.2, 0.2]])
    never = np.zeros((2, 3), dtype=bool)
    assert smallest_time_to_collision(times, distances, never) == pytest.approx(0.8)
    assert smallest_time_to_collision(times, distances[1:], never[1:]) is None, "what keeps its distance is no danger"
    assert smallest_time_to_collision(times, np.full((1, 4), math.inf), never[1:]) is None
    assert smallest_time_to_collision(times, np.zeros((0, 4)), never[2:]) is None


def test_a_mover_that_starts_over_does_not_come_as_fast_as_it_jumps():
    """One that walked away and began anew 4 m off was told as a collision within a tenth of a second."""
    body = Body("walker", Cylinder(0.2, 1.7), Frame.of(0.0, 0.0, 0.85))
    walker = Mover(body, np.array([0.0, 5.0]), np.array([[4.0, 0.0, 0.0], [9.0, 0.0, 0.0]]))
    world = World("walked", (), movers=(walker,))
    record = Record(EpisodeTask("walked", world, (HERE,), 30.0), 1, 0.0, load_robot("burger"))
    for time in np.arange(0.0, 12.0, 0.1):
        record.note(float(time), HERE, HERE)
    assert record.result("TIMEOUT", "", 0.22, [], None, {}).time_to_collision is None


def driven(tmp_path, world, after_contact, **server):
    setup = make_setup(config_folder(), has_map=False, after_contact=after_contact)
    setup.settings[SERVER].update(server)
    task = load_tasks(small_worlds.write(tmp_path / "worlds.json", world))[0]
    return task, Episode(task, setup, seed=1).run()


def test_a_drive_goes_on_after_somebody_ran_into_a_robot_that_stood(tmp_path):
    """It counts as failed all the same, and tells that the robot was not at fault."""
    by_planning = {"planners": [{"name": "own", "type": "small_worlds.Never"}], "planner_patience": 60.0}
    world = {**small_worlds.RUN_OVER, "time_limit": 6.0}
    _, ended = driven(tmp_path, world, False, **by_planning)
    task, went_on = driven(tmp_path, world, True, **by_planning)
    for result in (ended, went_on):
        assert result.outcome == "CONTACT" and not result.success
        assert result.contacts == 1 and result.contacts_at_fault == 0, result.message
    assert went_on.contact_times == ended.contact_times == pytest.approx([ended.time], abs=0.02)
    assert went_on.time > ended.time + 1.0 and "TIMEOUT" in went_on.message
    assert 0.0 <= ended.time_to_collision < 0.5 and ended.closest_approach < 0.05
    assert EpisodeResult.from_line(went_on.to_line()).contact_times == went_on.contact_times
    drawn = drive_of(task, went_on).contacts
    assert [contact.stamp for contact in drawn] == list(went_on.contact_times), "drawn where it was, not at the end"


def test_a_robot_that_is_pushed_onto_a_post_while_it_stands_is_not_at_fault(tmp_path):
    """Who stood was told to have driven into what somebody pushed it onto."""
    world = {**small_worlds.RUN_OVER, "cylinders": [[-0.35, 0.0, 0.1, 0.5]], "time_limit": 6.0}
    _, result = driven(tmp_path, world, True, planners=[{"name": "own", "type": "small_worlds.Never"}],
                       planner_patience=60.0)
    assert result.contacts == 2 and result.contacts_at_fault == 0, result.message

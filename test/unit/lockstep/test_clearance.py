"""Clearances against plain geometry, and what makes two tasks the same."""

import dataclasses
import math

import numpy as np
import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.lockstep.clearance import smallest_clearance
from mbf_relay.lockstep.clearance_kernels import hull_clearances
from mbf_relay.lockstep.record import Record, velocities
from mbf_relay.lockstep.tasks import EpisodeTask
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.robot_file import load_robot
from mbf_relay.simulation.shapes import Body, Box, Cylinder
from mbf_relay.simulation.world import Mover, World

BURGER = load_robot("burger")
HULL = BURGER.outline
SQUARE = np.array([[0.1, 0.1], [-0.1, 0.1], [-0.1, -0.1], [0.1, -0.1]])


def along(segments, count=400):
    """Return points on segments (M, 2, 2)."""
    shares = np.linspace(0.0, 1.0, count)[None, :, None]
    return (segments[:, None, 0] + shares * (segments[:, None, 1] - segments[:, None, 0])).reshape(-1, 2)


def plain_clearance(pose, hull, segment):
    """Return the distance of a segment to a convex outline by sampling both; 0 where a point of it lies inside."""
    local = pose.inverse().transform_points(along(segment.reshape(1, 2, 2)))
    if ((local > hull.min(axis=0)) & (local < hull.max(axis=0))).all(axis=1).any():
        return 0.0
    outline = along(np.stack((hull, np.roll(hull, -1, axis=0)), axis=1))
    return float(np.hypot(*(local[:, None] - outline[None]).T).min())


def test_kernel_agrees_with_sampling():
    rng = np.random.default_rng(5)
    for _ in range(60):
        pose = Pose2D(*rng.uniform(-0.5, 0.5, 2), rng.uniform(-math.pi, math.pi))
        segment = rng.uniform(-0.8, 0.8, 4)
        made = np.full(1, math.inf)
        hull_clearances(np.array([pose]), SQUARE, segment[None].copy(), made)
        assert made[0] == pytest.approx(plain_clearance(pose, SQUARE, segment), abs=2e-3)


def test_a_drive_past_many_is_told_what_each_pose_alone_is_told_of_each():
    rng = np.random.default_rng(6)
    segments, poses = rng.uniform(-3.0, 3.0, (60, 4)), np.cumsum(rng.uniform(-0.2, 0.2, (80, 3)), axis=0)
    segments[:, 2:] = segments[:, :2] + 0.1 * segments[:, 2:]
    made, alone = np.full(80, math.inf), np.full((80, 60), math.inf)
    hull_clearances(poses, SQUARE, segments, made)
    for pose, row in zip(poses, alone):
        for index in range(60):
            hull_clearances(pose[None].copy(), SQUARE, segments[index:index + 1].copy(), row[index:index + 1])
    assert (made == alone.min(axis=1)).all()


def test_nearest_of_many_is_found_and_larger_values_are_only_lowered():
    segments = np.array([[1.0, -1.0, 1.0, 1.0], [0.4, -1.0, 0.4, 1.0], [3.0, 0.0, 4.0, 0.0]])
    made = np.array([math.inf, 0.05])
    hull_clearances(np.zeros((2, 3)), SQUARE, segments, made)
    assert made == pytest.approx([0.3, 0.05])


def test_an_edge_of_no_length_is_as_near_as_its_point():
    """A mesh may have them, and the report on the drive would end in a division by zero."""
    made = np.full(1, math.inf)
    hull_clearances(np.zeros((1, 3)), SQUARE, np.array([[0.4, 0.05, 0.4, 0.05], [2.0, 0.0, 2.0, 1.0]]), made)
    assert made == pytest.approx([0.3])


def pillar(x, y):
    return Body("pillar", Cylinder(0.1, 0.5), Frame.of(x, y, 0.25))


def test_clearance_to_a_pillar_and_in_an_empty_world():
    poses = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]])
    made = smallest_clearance(World("one", (pillar(1.0, 0.0),)), np.arange(2.0), poses, BURGER)
    assert made == pytest.approx(1.0 - 0.1 - 0.2 - HULL[:, 0].max(), abs=2e-4)
    assert smallest_clearance(World("none", ()), np.arange(2.0), poses, BURGER) is None


@pytest.mark.parametrize("low, high", [(0.0, 0.1), (0.3, 0.32), (0.0, 0.5), (0.3, 2.0)])
@pytest.mark.parametrize("moves", [False, True])
def test_clearance_to_what_is_low_or_hangs_is_told(low, high, moves):
    """A robot 0.4 m high touched a box of 0.1 m, and its clearance was told as if nothing had been there."""
    medium = load_robot("medium")
    thing = Body("thing", Box((0.2, 0.2, high - low)), Frame.of(1.0, 0.0, 0.5 * (low + high)))
    mover = Mover(thing, np.zeros(1), np.array([[1.0, 0.0, 0.0]]))
    world = World("one", (), movers=(mover,)) if moves else World("one", (pillar(0.0, 9.0), thing, pillar(0.0, -9.0)))
    made = smallest_clearance(world, np.zeros(1), np.zeros((1, 3)), medium)
    assert made == pytest.approx(1.0 - 0.1 - medium.outline[:, 0].max(), abs=1e-9)


@pytest.mark.parametrize("low, high", [(0.0, 0.01), (0.2, 0.3)])
def test_what_is_rolled_over_or_passed_under_has_no_clearance(low, high):
    slab = Body("slab", Box((9.0, 9.0, high - low)), Frame.of(0.0, 0.0, 0.5 * (low + high)))
    assert smallest_clearance(World("slab", (slab,)), np.zeros(1), np.zeros((1, 3)), BURGER) is None


def test_clearance_to_a_mover_counts_where_it_is_at_that_time():
    mover = Mover(pillar(0.0, 0.0), np.array([0.0, 10.0]), np.array([[2.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), loop=False)
    world = World("moving", (), movers=(mover,))
    standing = np.zeros((3, 3))
    made = smallest_clearance(world, np.array([0.0, 5.0, 10.0]), standing, BURGER)
    assert made == pytest.approx(1.0 - 0.1 - HULL[:, 0].max(), abs=2e-4)
    at_first = smallest_clearance(world, np.zeros(3), standing, BURGER)
    assert at_first == pytest.approx(2.0 - 0.1 - HULL[:, 0].max(), abs=2e-4)


def test_velocities_of_an_arc():
    times = np.arange(0.0, 2.0, 0.1)
    poses = np.column_stack((2.0 * np.sin(0.5 * times), 2.0 - 2.0 * np.cos(0.5 * times), 0.5 * times))
    forward, angular = velocities(times, poses)
    assert forward[1:] == pytest.approx(np.full(19, 1.0), abs=2e-4)
    assert angular[1:] == pytest.approx(np.full(19, 0.5))
    assert (forward[0], angular[0]) == (0.0, 0.0)


def test_driving_backwards_is_negative():
    forward, _ = velocities(np.arange(3.0), np.array([[0.0, 0.0, 0.0], [-0.1, 0.0, 0.0], [-0.2, 0.0, 0.0]]))
    assert forward[1:] == pytest.approx([-0.1, -0.1])


def test_a_task_is_told_from_others_by_what_is_in_it():
    task = EpisodeTask("a", World("a", (pillar(1.0, 0.0),)), (Pose2D(2.0, 0.0, 0.0),), 30.0)
    again = EpisodeTask("a", World("a", (pillar(1.0, 0.0),)), (Pose2D(2.0, 0.0, 0.0),), 30.0)
    assert task.digest() == again.digest()
    moved = dataclasses.replace(task, world=World("a", (pillar(1.01, 0.0),)))
    later = dataclasses.replace(task, time_limit=31.0)
    assert len({task.digest(), moved.digest(), later.digest()}) == 3


def test_a_batch_does_not_go_on_in_a_world_whose_loose_things_were_moved_or_made_heavier():
    """A box on the robot's way was put aside, and the same command said that all was driven already."""
    def task(*bodies):
        return EpisodeTask("a", World("a", bodies), (Pose2D(2.0, 0.0, 0.0),), 30.0)

    bodies = [dataclasses.replace(pillar(x, 0.0), mass=mass) for x, mass in ((1.0, 2.0), (1.5, 2.0), (1.0, 3.0))]
    assert len({task(body).digest() for body in bodies} | {task().digest()}) == 4
    assert task(bodies[0]).digest() == task(bodies[0]).digest()


def test_whoever_stands_beside_somebody_all_the_time_does_so_for_as_long_as_the_drive_lasts():
    """It was told as 12.407 s of a drive of 12.308: a share above 1."""
    man = Mover(Body("man", Cylinder(0.05, 1.0), Frame.of(0.0, 0.0, 0.5)), np.zeros(1), np.array([[0.15, 0.0, 0.0]]))
    goal = Pose2D(1.0, 0.0, 0.0)
    record = Record(EpisodeTask("beside", World("beside", (), movers=(man,)), (goal,), 9.0), 1, 5.0, BURGER)
    for time in (5.0, 5.1, 5.2, 5.21):
        record.note(time, Pose2D(0.0, 0.0, 0.0), Pose2D(0.0, 0.0, 0.0))
    result = record.result("TIMEOUT", "", 0.22, [], None, {})
    assert result.personal_space_time == pytest.approx(0.21) and result.close_time == pytest.approx(0.21)
    assert result.time == pytest.approx(0.21)


@pytest.mark.parametrize("heading", [0.0, math.pi / 2, 2.0])
def test_an_omnidirectional_robot_drives_as_calmly_whichever_way_it_looks(heading):
    """One that went sideways all the way was told to stand all the time, and without any acceleration."""
    goal = Pose2D(1.0, 0.0, heading)
    record = Record(EpisodeTask("aside", World("aside", ()), (goal,), 9.0), 1, 0.0, load_robot("omni"))
    for time in np.arange(0.0, 2.05, 0.1):
        pose = Pose2D(0.1 * time ** 2, 0.0, heading)
        record.note(float(time), pose, pose)
    figures = record.result("TIMEOUT", "", 0.5, [], None, {}).smoothness
    assert figures.mean_acceleration == pytest.approx(0.2, rel=0.06) and figures.standing_share < 0.1

"""Solids as triangles: closed, of the right size, and cut where they should be."""

import math

import numpy as np
import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.simulation.clearance import obstruction
from mbf_relay.simulation.frames import Frame, quaternion_from_rotation, rotation_from_quaternion, rotation_from_rpy
from mbf_relay.simulation.robot_file import load_robot
from mbf_relay.simulation.shapes import (
    ROUNDNESS,
    Body,
    Box,
    Cylinder,
    Mesh,
    Sphere,
    bounds,
    cut,
    indexed,
    prism_triangles,
    regular_polygon,
    ring_triangles,
    subdivided,
)

HEXAGON = regular_polygon(1.0, 6)
SOLIDS = [
    (Box((1.0, 2.0, 3.0)), 6.0),
    (Cylinder(0.15, 0.5), math.pi * 0.15 ** 2 * 0.5),
    (Cylinder(3.0, 0.5), math.pi * 9.0 * 0.5),
    (Sphere(0.4), 4.0 / 3.0 * math.pi * 0.4 ** 3),
    (Mesh(prism_triangles(HEXAGON, 0.0, 2.0)), 2.0 * 1.5 * math.sqrt(3.0)),
    (Mesh(ring_triangles(HEXAGON, 2.0 * HEXAGON, 0.0, 1.0)), 3.0 * 1.5 * math.sqrt(3.0)),
]


def volume(triangles):
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def edges(triangles):
    rounded = np.round(triangles, 9)
    for triangle in rounded:
        for i in range(3):
            yield tuple(triangle[i]), tuple(triangle[(i + 1) % 3])


@pytest.mark.parametrize("shape, expected", SOLIDS)
def test_surfaces_are_closed_face_outwards_and_hold_the_volume(shape, expected):
    triangles = shape.triangles()
    assert volume(triangles) == pytest.approx(expected, rel=4.0 * ROUNDNESS / 0.15)
    directed = list(edges(triangles))
    assert len(set(directed)) == len(directed)
    assert {(b, a) for a, b in directed} == set(directed)


@pytest.mark.parametrize("radius", [0.005, 0.03, 0.15, 1.0, 20.0])
def test_round_surfaces_stay_within_the_roundness(radius):
    triangles = Cylinder(radius, 1.0).triangles()
    distances = np.linalg.norm(triangles.reshape(-1, 3)[:, :2], axis=1)
    corners = distances[distances > 0.0]
    assert corners.max() - radius <= ROUNDNESS
    middles = triangles[:, :2, :2].mean(axis=1)
    assert radius - np.linalg.norm(middles, axis=1).max() <= ROUNDNESS


def test_a_cut_runs_round_a_solid_once():
    segments, indices = cut(Body("box", Box((2.0, 1.0, 1.0)), Frame.of(0.0, 0.0, 0.5)).triangles(), 0.2)
    assert np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1).sum() == pytest.approx(6.0)
    assert len(indices) == len(segments)


def test_a_cut_above_or_below_is_empty():
    triangles = Box((1.0, 1.0, 1.0)).triangles()
    for height in (-0.6, 0.6):
        segments, indices = cut(triangles, height)
        assert segments.shape == (0, 2, 2) and indices.shape == (0,)


def test_subdividing_keeps_the_surface_and_bounds_the_edges():
    triangles = Box((4.0, 0.1, 1.0)).triangles()
    pieces = subdivided(triangles, 0.3)
    assert np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2).max() <= 0.3
    assert volume(pieces) == pytest.approx(0.4)
    assert len(subdivided(triangles, 10.0)) == 12 and subdivided(np.empty((0, 3, 3)), 1.0).shape == (0, 3, 3)


@pytest.mark.parametrize("longest", [0.29, 0.31, 0.6, 0.68])
def test_what_is_short_enough_already_stays_as_it_is(longest):
    triangles = Cylinder(0.2, 0.6).triangles()
    pieces = subdivided(triangles, longest)
    assert len(pieces) > len(triangles) or (pieces == triangles).all()
    assert np.linalg.norm(np.roll(pieces, -1, axis=1) - pieces, axis=2).max() <= longest


def test_bounds_are_those_over_the_corners():
    triangles = np.random.default_rng(1).normal(size=(50, 3, 3))
    for corners in (triangles, triangles[:, :, :2], triangles[:, :, 2]):
        lowest, highest = bounds(corners)
        assert (lowest == corners.min(axis=1)).all() and (highest == corners.max(axis=1)).all()


@pytest.mark.parametrize("count", [0, 1, 500])
def test_a_mesh_of_shared_corners_is_the_same_surface_with_each_corner_once(count):
    triangles = np.random.default_rng(1).integers(-2, 3, (count, 3, 3)) / 4.0
    corners, indices = indexed(triangles)
    assert np.array_equal(corners[indices].reshape(-1, 3, 3), triangles)
    assert [*map(tuple, corners.tolist())] == sorted({*map(tuple, triangles.reshape(-1, 3).tolist())})


def test_nobody_can_bend_a_surface_that_alike_cylinders_share():
    with pytest.raises(ValueError, match="read-only"):
        Cylinder(0.1, 1.0).triangles()[0] = 0.0


@pytest.mark.parametrize(
    "make",
    [
        lambda: Box((1.0, 0.0, 1.0)),
        lambda: Cylinder(-0.1, 1.0),
        lambda: Cylinder(0.1, math.inf),
        lambda: Sphere(math.nan),
        lambda: Mesh(np.empty((0, 3, 3))),
        lambda: Mesh(np.full((1, 3, 3), np.nan)),
        lambda: Mesh(np.zeros((4, 3))),
    ],
)
def test_impossible_solids_are_refused(make):
    with pytest.raises(ValueError):
        make()


def test_quaternions_and_matrices_agree():
    rng = np.random.RandomState(3)
    for roll, pitch, yaw in list(rng.uniform(-math.pi, math.pi, (200, 3))) + [
        (math.pi, 0, 0),
        (0, 0, math.pi),
        (math.pi, 0, math.pi),
    ]:
        rotation = rotation_from_rpy(roll, pitch, yaw)
        assert np.allclose(rotation @ rotation.T, np.eye(3)) and np.linalg.det(rotation) == pytest.approx(1.0)
        assert np.allclose(rotation_from_quaternion(quaternion_from_rotation(rotation)), rotation)
    with pytest.raises(ValueError, match="no rotation"):
        rotation_from_quaternion((0.0, 0.0, 0.0, 0.0))


def test_frames_compose_and_invert():
    a, b = Frame.of(1.0, 2.0, 3.0, 0.1, 0.2, 0.3), Frame.of(-1.0, 0.5, 0.0, 0.0, 0.4, 2.0)
    point = np.array([0.3, -0.7, 1.1])
    assert np.allclose(a.compose(b).transform_points(point), a.transform_points(b.transform_points(point)))
    assert np.allclose(a.inverse().transform_points(a.transform_points(point)), point)
    pose = Pose2D(1.0, -2.0, 2.5)
    assert Frame.from_pose(pose).flat() == pytest.approx(pose)


WALL = Body("wall", Box((0.2, 4.0, 1.0)), Frame.of(1.0, 0.0, 0.5)).triangles()
BIG = Body("big", Box((3.0, 3.0, 1.0)), Frame.of(0.0, 0.0, 0.5)).triangles()
LOW = Body("low", Box((0.1, 0.1, 0.02)), Frame.of(0.0, 0.0, 0.01)).triangles()
HIGH = Body("high", Box((0.1, 0.1, 0.1)), Frame.of(0.0, 0.0, 0.4)).triangles()


@pytest.mark.parametrize("triangles, pose, expected", [
    (WALL, Pose2D(0.0, 0.0, 0.0), False),
    (WALL, Pose2D(0.85, 0.0, 0.0), False),
    (WALL, Pose2D(0.87, 0.0, 0.0), True),
    (WALL, Pose2D(0.85, 0.0, math.pi), True),
    (WALL, Pose2D(1.0, 0.0, 0.0), True),
    (BIG, Pose2D(0.0, 0.0, 0.0), True),
    (LOW, Pose2D(0.0, 0.0, 0.0), True),
    (HIGH, Pose2D(0.0, 0.0, 0.0), False),
])
def test_room_for_the_robot(triangles, pose, expected):
    owner = obstruction(triangles, np.zeros(len(triangles), dtype=int), pose, load_robot("burger"))
    assert (owner is not None) is expected


def test_the_obstructing_body_is_named_by_its_owner():
    far = Body("far", Box((1.0, 1.0, 1.0)), Frame.of(5.0, 0.0, 0.5)).triangles()
    triangles = np.concatenate((far, BIG))
    owners = np.repeat([4, 9], [len(far), len(BIG)])
    assert obstruction(triangles, owners, Pose2D(0.0, 0.0, 0.0), load_robot("burger")) == 9
    assert obstruction(triangles, owners, Pose2D(5.0, 0.0, 0.0), load_robot("burger")) == 4
    assert obstruction(triangles, owners, Pose2D(-3.0, 0.0, 0.0), load_robot("burger")) is None

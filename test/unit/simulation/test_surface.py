"""Rays against fixed surfaces: what the sorted triangles answer, against a look at every triangle."""

import math

import numpy as np
import pytest

from mbf_relay.simulation.arena import arena
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import Body, Box, Cylinder
from mbf_relay.simulation.surface import Surface


def plain_cast(triangles, start, ends):
    """Solve start + share (end - start) = corner + u edge + v other edge for every ray and triangle."""
    shares = np.ones(len(ends))
    for ray, end in enumerate(ends):
        for corner, second, third in triangles:
            matrix = np.column_stack((start - end, second - corner, third - corner))
            if abs(np.linalg.det(matrix)) < 1e-12:
                continue
            share, u, v = np.linalg.solve(matrix, start - corner)
            if share >= 0.0 and u >= 0.0 and v >= 0.0 and u + v <= 1.0:
                shares[ray] = min(shares[ray], share)
    return shares


def around(start, radius, count=60, slope=0.0):
    """Return the ends of rays all round, each rising or falling by up to `slope`."""
    angles = 2.0 * math.pi * np.arange(count) / count
    rise = slope * np.sin(7.0 * angles)
    return start + radius * np.column_stack((np.cos(angles), np.sin(angles), rise))


@pytest.mark.parametrize("seed", range(5))
def test_answers_as_a_look_at_every_triangle_does(seed):
    rng = np.random.Generator(np.random.PCG64(seed))
    corners = rng.uniform(-3.0, 3.0, (40, 1, 3)) * (1.0, 1.0, 0.1)
    triangles = corners + rng.normal(0.0, 0.4, (40, 3, 3))
    surface = Surface(triangles)
    for start in rng.uniform(-5.0, 5.0, (4, 3)) * (1.0, 1.0, 0.05):
        ends = around(start, 4.0, slope=0.1)
        expected = plain_cast(triangles, start, ends)
        assert (expected < 1.0).sum() > 0 or abs(start).max() > 3.0
        assert surface.cast(start, ends) == pytest.approx(expected, abs=1e-9)


def test_answers_so_in_the_arena():
    triangles = arena().fixed_triangles()[0]
    surface = Surface(triangles)
    start = np.array([-2.0, -0.5, 0.182])
    ends = around(start, 3.5, count=36, slope=0.02)
    assert surface.cast(start, ends) == pytest.approx(plain_cast(triangles, start, ends), abs=1e-9)


@pytest.mark.parametrize("size", [(2.0, 2.0, 1.0), (0.5, 0.25, 0.1), (40.0, 3.0, 1.0)])
def test_nothing_slips_between_two_triangles(size):
    triangles = Body("room", Box(size), Frame.of(0.0, 0.0)).triangles()
    half, side, height = np.array(size) / 2.0, np.ones(41), np.linspace(-0.5, 0.5, 41)
    walls = [half * np.column_stack((sign * side, 2.0 * height, height)) for sign in (-1.0, 1.0)]
    walls += [half * np.column_stack((2.0 * height, sign * side, height)) for sign in (-1.0, 1.0)]
    on_walls = np.concatenate(walls)
    assert Surface(triangles).cast(np.zeros(3), 2.0 * on_walls) == pytest.approx(np.full(164, 0.5))


def test_rays_along_the_borders_of_cells_meet_what_lies_on_them():
    step = np.array([[[0.0, y, 0.0], [0.0, y + 0.25, 0.0], [0.0, y, 1.0]] for y in np.arange(-1.0, 1.0, 0.25)])
    start = np.array([-1.0, 0.0, 0.1])
    ends = np.array([[1.0, y, 0.1] for y in np.arange(-0.75, 1.0, 0.25)])
    assert (Surface(step).cast(start, ends) == pytest.approx(np.full(len(ends), 0.5)))


def test_many_small_triangles_and_few_large_ones_are_sorted_alike():
    pillars = [Body("p", Cylinder(0.05, 1.0), Frame.of(x, y, 0.5)) for x in (-0.2, 0.0, 0.2) for y in (0.4, 0.6)]
    far = Body("far", Box((1.0, 60.0, 1.0)), Frame.of(300.0, 0.0, 0.5, yaw=0.3))
    triangles = np.concatenate([body.triangles() for body in pillars])
    start = np.array([0.0, 0.0, 0.2])
    ends = around(start, 1.0, count=90)
    expected = plain_cast(triangles, start, ends)
    assert Surface(triangles).cast(start, ends) == pytest.approx(expected, abs=1e-9)
    with_far = Surface(np.concatenate((triangles, far.triangles())))
    assert with_far.cast(start, ends) == pytest.approx(expected, abs=1e-9)
    assert with_far.cast(start, np.array([[400.0, 0.0, 0.2]]))[0] == pytest.approx(299.5 / 400.0, abs=1e-3)


def test_an_empty_world_and_a_start_far_off_meet_nothing():
    start = np.array([0.0, 0.0, 0.2])
    assert (Surface(np.empty((0, 3, 3))).cast(start, around(start, 3.5)) == 1.0).all()
    away = np.array([100.0, 100.0, 0.2])
    assert (Surface(arena().fixed_triangles()[0]).cast(away, around(away, 3.5)) == 1.0).all()

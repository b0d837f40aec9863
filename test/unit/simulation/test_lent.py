"""A thousand worlds in one process: what PyBullet was handed for one of them is given back."""

import gc
import tracemalloc

import numpy as np
import pytest

pytest.importorskip("pybullet")

from mbf_relay.simulation.lent import create_mesh  # noqa: E402
from mbf_relay.simulation.physics import FIXED, ROBOT, Physics  # noqa: E402


def test_a_closed_world_leaves_nothing_behind():
    triangles = np.random.default_rng(1).normal(size=(1000, 3, 3))

    def build():
        physics = Physics(200, 10)
        physics.add_fixed(triangles, FIXED, ROBOT)
        physics.close()

    build()  # what is kept for good is there after this
    tracemalloc.start()
    try:
        build()
        gc.collect()
        before = tracemalloc.get_traced_memory()[0]
        build()
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] - before < 50_000, "PyBullet keeps the corners of every world"
    finally:
        tracemalloc.stop()


def test_a_mesh_is_handed_over_as_it_is():
    handed = {}

    def create(vertices, indices, **others):
        handed.update(vertices=[list(corner) for corner in vertices], indices=list(indices), **others)
        return 7

    corners = np.arange(12.0).reshape(4, 3)
    assert create_mesh(create, corners, np.array([0, 1, 2, 1, 2, 3]), shapeType=5) == 7
    assert handed == {"vertices": corners.tolist(), "indices": [0, 1, 2, 1, 2, 3], "shapeType": 5}

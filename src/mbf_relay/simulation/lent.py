"""Corners and indices of meshes for PyBullet, which never lets go of the lists it is handed.

Each call that takes a mesh leaves two references on the list of corners, on every corner in it and on the list of
indices, in versions 3.2.5 to 3.2.7 at least: megabytes a world. So the corners are lists that are lent again for the
next mesh, and the lists that held them are emptied.
"""

from __future__ import annotations

from typing import Any, Callable, List, Optional

import numpy as np

_corners: List[List[float]] = []


def create_mesh(
    create: Callable[..., int], vertices: np.ndarray, indices: Optional[np.ndarray] = None, **arguments: Any
) -> int:
    """Return the number of a shape that PyBullet makes of a mesh.

    Args:
        create: createCollisionShape or createVisualShape; called with `vertices`, `indices` and `arguments`.
        vertices: Shape (N, 3) in metres.
        indices: Shape (3 * M,); where None, PyBullet takes the hull of the vertices.
        arguments: Everything else the call takes.
    """
    while len(_corners) < len(vertices):
        _corners.append([0.0, 0.0, 0.0])
    lent = _corners[:len(vertices)]
    for corner, values in zip(lent, vertices.tolist()):
        corner[:] = values
    if indices is None:
        shape = create(vertices=lent, **arguments)
    else:
        numbers = indices.tolist()
        shape = create(vertices=lent, indices=numbers, **arguments)
        numbers.clear()
    lent.clear()
    return shape

"""Creates PyBullet meshes without its memory leak.

In versions 3.2.5 to 3.2.7 at least, each call with a mesh leaks two references to the list of vertices, to every vertex
in it and to the list of indices: megabytes a world. So the vertices are lists that are reused for the next mesh, and
the lists that held them are emptied.
"""

from __future__ import annotations

from typing import Any, Callable, List, Optional

import numpy as np

_corners: List[List[float]] = []  # the vertices that are reused


def create_mesh(
    create: Callable[..., int], vertices: np.ndarray, indices: Optional[np.ndarray] = None, **arguments: Any
) -> int:
    """Create a shape from a mesh; return PyBullet's number of it.

    Args:
        create: createCollisionShape or createVisualShape; called with `vertices`, `indices` and `arguments`.
        vertices: Shape (N, 3) in metres.
        indices: Vertices of each triangle, shape (3 * M,); where None, PyBullet takes the vertices' convex hull.
        arguments: Further arguments of the call.
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

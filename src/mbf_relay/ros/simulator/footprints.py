"""Check that nodes that drive the simulated robot have a footprint at least as large as it."""

from __future__ import annotations

from typing import Any, Iterable, List, Mapping, Set

from mbf_relay.costmap.factory import SEARCHED_NAMES
from mbf_relay.costmap.outline import clearances, padded
from mbf_relay.costmap.parameters import CostmapParameters
from mbf_relay.simulation.robot import RobotModel

COSTMAP = "local_costmap"
"""Group of the costmap that is used to avoid collisions."""
COVERS = 0.02
"""Distance (m) by which a robot may reach out of its footprint, for rounded numbers in files."""


def drivers(names: Iterable[str], namespace: str) -> Set[str]:
    """Return the nodes in a namespace that have a local costmap, by the names of all parameters there are."""
    inside = f"/{COSTMAP}/"
    return {name.partition(inside)[0] for name in names if inside in name and name.startswith(namespace)} - {""}


def too_small_footprints(nodes: Mapping[str, Mapping[str, Any]], robot: RobotModel) -> List[str]:
    """Return a line for each node whose local costmap has a footprint that a robot reaches out of.

    Args:
        nodes: Their parameters, by name.
        robot: What is simulated.
    """
    lines = []
    for node, values in nodes.items():
        searched = {name: values[name] for name in SEARCHED_NAMES if name in values}
        try:
            parameters = CostmapParameters.read({**searched, **values.get(COSTMAP, {})})[0]
            outline = padded(parameters.outline(), parameters.footprint_padding)
        except ValueError:
            continue  # the node itself says so
        out = float(clearances(robot.footprint, outline).max(initial=0.0))
        if out > COVERS:
            lines.append(
                f"{robot.name}, which is simulated, reaches by {out:.2f} m out of the footprint that the local costmap "
                f"of {node} has: it will touch what it is taken to pass. What `rosrun mbf_relay robot_parameters.py` "
                "prints for it may be given as overrides, or config be a file of its own")
    return lines

"""The planner used in place of planners of other packages, which are not implemented here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Mapping

from mbf_relay.planning.navfn import NavfnParameters, NavfnPlanner


@dataclass(frozen=True)
class StandInParameters(NavfnParameters):
    """Parameters of NavfnPlanner where it replaces another planner, read from that one's group."""

    @classmethod
    def unknown_names(cls, values: Mapping[str, Any]) -> List[str]:
        """Return nothing: the group holds the other planner's parameters, and `stands_in` already warns of it."""
        return []


class NavfnStandIn(NavfnPlanner):
    """Plans as navfn does where a planner of another package is asked for."""

    Parameters = StandInParameters
    parameters: StandInParameters
    stands_in = "NavfnPlanner finds the path, and controllers see to how the robot can turn"

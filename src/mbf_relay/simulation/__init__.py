"""Simulation: worlds, robots, their sensors, and the physics (only this package imports pybullet).

`Simulation` is imported on first use, so that worlds and their geometry can be used without pybullet.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mbf_relay.simulation.simulation import Simulation as Simulation


def __getattr__(name: str) -> Any:
    if name == "Simulation":
        from mbf_relay.simulation.simulation import Simulation

        return Simulation
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

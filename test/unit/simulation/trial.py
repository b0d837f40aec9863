"""Small worlds for tests, without chance unless asked for, and what it takes to drive in them."""

from mbf_relay.geometry import Pose2D
from mbf_relay.simulation import Simulation
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.shapes import Body, Box
from mbf_relay.simulation.world import World

EXACT = dict(scan_noise=0.0, scan_resolution=0.0, odom_noise=0.0)
SENSOR_X = -0.032
"""Where the lidar stands in base_footprint (m)."""


def simulate(bodies=(), seed=1, start=Pose2D(0.0, 0.0, 0.0), movers=(), **changes):
    return Simulation(
        World("test", tuple(bodies), start, tuple(movers)), SimulationParameters(**{**EXACT, **changes}), seed
    )


def run(simulation, seconds, command=None):
    """Step for some time, a command given anew at 20 Hz, and return everything observed."""
    seen = []
    for step in range(round(seconds * simulation.parameters.physics_rate)):
        if command is not None and step % 6 == 0:
            simulation.set_command(command)
        seen.append(simulation.step())
    return seen


def last_scan(simulation, seconds=0.2):
    return [o.scan for o in run(simulation, seconds) if o.scan is not None][-1]


def box(name, x, y, size, yaw=0.0):
    return Body(name, Box(size), Frame.of(x, y, size[2] / 2.0, yaw=yaw))

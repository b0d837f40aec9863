"""A guard between navigation and wheels: it lets a good drive be, and stops a bad one before anything is touched."""

import numpy as np
import pytest

pytest.importorskip("pybullet")

from driven import circle_by_amcl  # noqa: E402

from mbf_relay.control import velocity_guard as guards  # noqa: E402
from mbf_relay.control.velocity_guard import VelocityGuard  # noqa: E402
from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters  # noqa: E402
from mbf_relay.geometry import STOP, Twist2D  # noqa: E402
from mbf_relay.lockstep.episode import Episode  # noqa: E402
from mbf_relay.lockstep.graph import Graph  # noqa: E402
from mbf_relay.lockstep.settings import config_folder  # noqa: E402
from mbf_relay.lockstep.setup import SERVER, make_setup  # noqa: E402
from mbf_relay.lockstep.tasks import circle  # noqa: E402
from mbf_relay.simulation import Simulation, arena  # noqa: E402
from mbf_relay.simulation.faults import Faults  # noqa: E402
from mbf_relay.simulation.parameters import SimulationParameters  # noqa: E402
from mbf_relay.simulation.robot_file import load_robot  # noqa: E402

LASER_IN_BASE = load_robot("burger").scan_in_base.flat()

SEEING = make_setup(config_folder())
FOOTPRINT = SEEING.settings[SERVER]["local_costmap"]["footprint"]


def burger_guard():
    return VelocityGuard(VelocityGuardParameters(footprint=FOOTPRINT, base_frame="base_footprint"))


class GuardedGraph(Graph):
    """A graph whose velocities pass a guard."""

    def __init__(self, *arguments):
        self.guard, self.causes = burger_guard(), []
        super().__init__(*arguments)

    def _take_scan(self, scan):
        self.guard.take_scan(scan, LASER_IN_BASE)
        super()._take_scan(scan)

    def _command(self, velocity):
        self.guard.take_command(self.now, velocity)
        verdict = self.guard.verdict(self.now)
        self.causes.append(verdict.cause)
        super()._command(verdict.velocity)


def test_the_circle_takes_no_longer_under_guard(monkeypatch):
    free = circle_by_amcl()
    monkeypatch.setattr("mbf_relay.lockstep.episode.Graph", GuardedGraph)
    episode = Episode(circle(), SEEING, seed=1)
    guarded = episode.run()
    assert guarded.goals_reached == 8 and guarded.contacts == 0
    assert guarded.time == pytest.approx(free.time, rel=0.01)
    interfered = [cause for cause in episode._graph.causes if cause not in (guards.PASSING, guards.STANDING)]
    assert len(interfered) <= 0.01 * len(episode._graph.causes), interfered


@pytest.mark.parametrize("seed, command_delay", [(0, 0.0), (1, 0.0), (2, 0.0), (3, 0.0), (3, 0.3), (3, 1.0), (4, 0.5)])
def test_a_robot_driven_blindly_touches_nothing(seed, command_delay):
    chance = np.random.default_rng(seed)
    simulation = Simulation(arena.arena(), SimulationParameters(), seed)
    simulation.faults = Faults(command_delay=command_delay)
    guard, slowed, moving, driven, before = burger_guard(), 0, STOP, 0.0, simulation.true_pose
    try:
        for step in range(120 * 60):
            if step % 120 == 0:
                blind = Twist2D(float(chance.uniform(-0.22, 0.22)), 0.0, float(chance.normal(0.0, 0.6)))
            seen = simulation.step()
            assert not seen.contacts, f"touched {seen.contacts[0].name} after {step / 120.0:.1f} s"
            if seen.scan is not None:
                guard.take_scan(seen.scan, LASER_IN_BASE)
            if seen.odometry is not None:
                moving = seen.odometry.velocity
            if step % 12 == 0:
                guard.take_command(simulation.now, blind, moving)
                verdict = guard.verdict(simulation.now)
                slowed += verdict.cause == guards.OBSTACLE
                simulation.set_command(verdict.velocity)
                driven += simulation.true_pose.distance_to(before)
                before = simulation.true_pose
    finally:
        simulation.close()
    assert slowed > 0, "it never came near to anything"
    assert driven > 4.0, "it was not let drive"
    assert guard.delay.seconds == pytest.approx(command_delay, abs=0.15)

"""A guard between navigation and wheels: it lets a good drive be, and stops a bad one before anything is touched."""

import numpy as np
import pytest

pytest.importorskip("pybullet")

from driven import circle_by_amcl  # noqa: E402

from mbf_relay.control import velocity_guard as guards  # noqa: E402
from mbf_relay.control.velocity_guard import VelocityGuard  # noqa: E402
from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters  # noqa: E402
from mbf_relay.geometry import Twist2D  # noqa: E402
from mbf_relay.lockstep.episode import Episode  # noqa: E402
from mbf_relay.lockstep.graph import Graph  # noqa: E402
from mbf_relay.lockstep.settings import config_folder  # noqa: E402
from mbf_relay.lockstep.setup import SERVER, make_setup  # noqa: E402
from mbf_relay.lockstep.tasks import circle  # noqa: E402
from mbf_relay.simulation import Simulation, arena  # noqa: E402
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


@pytest.mark.parametrize("seed", range(4))
def test_a_robot_driven_blindly_touches_nothing(seed):
    chance = np.random.default_rng(seed)
    simulation = Simulation(arena.arena(), SimulationParameters(), seed)
    guard, slowed = burger_guard(), 0
    try:
        for step in range(120 * 60):
            if step % 120 == 0:
                blind = Twist2D(float(chance.uniform(-0.22, 0.22)), 0.0, float(chance.normal(0.0, 0.6)))
            seen = simulation.step()
            assert not seen.contacts, f"touched {seen.contacts[0].name} after {step / 120.0:.1f} s"
            if seen.scan is not None:
                guard.take_scan(seen.scan, LASER_IN_BASE)
            if step % 12 == 0:
                guard.take_command(simulation.now, blind)
                verdict = guard.verdict(simulation.now)
                slowed += verdict.cause == guards.OBSTACLE
                simulation.set_command(verdict.velocity)
    finally:
        simulation.close()
    assert slowed > 0, "it never came near to anything"

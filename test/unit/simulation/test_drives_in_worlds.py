"""Drives in worlds out of files: walls stand where the file has them, and stop the robot."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")

from mbf_relay.geometry import Pose2D, Twist2D  # noqa: E402
from mbf_relay.simulation import Simulation  # noqa: E402
from mbf_relay.simulation.parameters import SimulationParameters  # noqa: E402
from mbf_relay.simulation.worlds import load_world  # noqa: E402

REPOSITORY = Path(__file__).resolve().parents[3]
ARENA_MAP = REPOSITORY / "config" / "maps" / "turtlebot3_world.yaml"
BARN = Path(os.environ.get("MBF_RELAY_SHARED", str(REPOSITORY.parent / "shared"))) / "data" / "barn_sample.json"
EXACT = SimulationParameters(scan_noise=0.0, scan_resolution=0.0)


def drive(simulation, speed, turn, seconds):
    """Drive and return the scans and what was touched."""
    scans, touched = [], []
    for step in range(round(seconds * simulation.parameters.physics_rate)):
        if step % 6 == 0:
            simulation.set_command(Twist2D(speed, 0.0, turn))
        seen = simulation.step()
        scans += [seen.scan] if seen.scan is not None else []
        touched += [contact.name for contact in seen.contacts]
    return scans, touched


def test_a_drive_among_the_walls_of_a_map():
    as_map, as_drawn = load_world(str(ARENA_MAP)), load_world("arena")
    with Simulation(as_map, EXACT, 1) as simulation, Simulation(as_drawn, EXACT, 1) as other:
        for made in (simulation, other):
            made.set_pose(Pose2D(-2.0, -0.5, 0.0))
        for command in ((0.2, 0.0, 2.0), (0.0, 0.8, 2.0), (0.2, 0.0, 2.0)):
            scans, touched = drive(simulation, *command)
            exact, _ = drive(other, *command)
            assert not touched
            assert simulation.true_pose.distance_to(other.true_pose) < 0.01
            both = np.isfinite(scans[-1].ranges) & np.isfinite(exact[-1].ranges)
            assert both.sum() > 250
            # The map's cells are 0.05 m wide, and a grazing beam slides past the corner of one.
            assert np.median(np.abs(scans[-1].ranges[both] - exact[-1].ranges[both])) < 0.04
        _, touched = drive(simulation, 0.22, 0.0, 15.0)
        assert set(touched) == {"wall"}


@pytest.mark.skipif(not BARN.exists(), reason="the shared data is not here")
def test_a_drive_in_a_sample_world():
    world = load_world(str(BARN), "barn_001")
    with Simulation(world, EXACT, 1) as simulation:
        scans, touched = drive(simulation, 0.1, 0.0, 2.0)
        assert not touched and world.start.distance_to(simulation.true_pose) == pytest.approx(0.2, abs=0.02)
        pose = simulation.true_pose
        scan = scans[-1]
        nearest = min(
            math.hypot(
                *(
                    body.frame.position[:2]
                    - (pose.x - 0.032 * math.cos(pose.theta), pose.y - 0.032 * math.sin(pose.theta))
                )
            )
            - body.shape.radius
            for body in world.bodies
        )
        assert scan.ranges.min() == pytest.approx(nearest, abs=0.02)
        _, touched = drive(simulation, 0.22, 0.0, 30.0)
        assert touched and set(touched) <= {body.name for body in world.bodies}

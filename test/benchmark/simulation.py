"""The simulation by itself: speed in three worlds, the time of a scan, how true the robot drives, the node's CPU share.
"""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Callable, Dict, Iterator, List, Sequence, Tuple

import numpy as np

from benchmark.metric import Metric, NotMeasurable, metric_of, time_call
from benchmark.processes import cpu_seconds
from benchmark.public_data import public_data
from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D, angle_between
from mbf_relay.maps import FREE, OCCUPIED, OccupancyMap
from mbf_relay.ros.tools.demo_graph import free_port
from mbf_relay.simulation.map_world import map_world
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.simulation import Simulation
from mbf_relay.simulation.world import World
from mbf_relay.simulation.worlds import load_world

SIMULATOR = Path(__file__).resolve().parents[2] / "scripts" / "simulator"
"""The node's executable."""

COMMAND_PERIOD = 0.05
Command = Tuple[float, float, float]
"""Speed (m/s), turn rate (rad/s) and for how long (s)."""

SQUARE: List[Command] = [(0.2, 0.0, 10.0), (0.0, 0.0, 0.5), (0.0, 0.5, math.pi), (0.0, 0.0, 0.5)] * 4
DRIVES: Dict[str, List[Command]] = {
    "straight 2 m": [(0.2, 0.0, 10.0)],
    "square 2 x 2 m": SQUARE,
    "ten turns on the spot": [(0.0, 1.0, 20.0 * math.pi)],
}

LISTENER = ["rostopic", "hz", "/scan", "/odom", "/tf", "/joint_states", "/imu", "/clock", "/ground_truth"]
DRIVER = ["rostopic", "pub", "-r", "10", "/cmd_vel", "geometry_msgs/Twist", "{linear: {x: 0.05}, angular: {z: 0.5}}"]


def metrics(quick: bool) -> Iterator[Metric]:
    """Measure speed and trueness, and yield what came of it."""
    for name, world in _worlds():
        yield from _speed(name, world, 5.0 if quick else 20.0, 3 if quick else 7)
    for name, commands in DRIVES.items():
        yield from _trueness(name, commands)
    yield from _cpu_share(5.0 if quick else 20.0)


def building(cells: int = 1000, seed: int = 1) -> OccupancyMap:
    """Return a map of a large floor: corridors, rooms with doors and furniture, at 0.05 m."""
    rng = np.random.Generator(np.random.PCG64(seed))
    data = np.full((cells, cells), FREE, dtype=np.int8)
    room = 100
    for line in range(0, cells, room):
        data[line:line + 3] = data[:, line:line + 3] = OCCUPIED
    for line in range(0, cells, room):
        for door in range(room // 2, cells, room):
            data[line:line + 3, door:door + 24] = data[door:door + 24, line:line + 3] = FREE
    for _ in range(cells * 3):
        row, column = rng.integers(0, cells - 8, 2)
        height, width = rng.integers(1, 8, 2)
        data[row:row + height, column:column + width] = OCCUPIED
    data[-3:] = data[:3] = OCCUPIED
    data[:, -3:] = data[:, :3] = OCCUPIED
    middle = cells // 2 + room // 2
    data[middle - 10:middle + 10, middle - 10:middle + 10] = FREE
    return OccupancyMap(data, 0.05, Pose2D(-0.05 * middle, -0.05 * middle, 0.0))


def _worlds() -> Iterator[Tuple[str, World]]:
    yield "arena", load_world("arena")
    yield "map 1000 x 1000", map_world("building", building())
    try:
        yield "BARN", load_world(str(public_data("barn_sample.json")))
    except NotMeasurable:
        return


def _speed(name: str, world: World, seconds: float, repeats: int) -> Iterator[Metric]:
    start = time.perf_counter()
    with Simulation(world, SimulationParameters(), 1) as simulation:
        where = {"world": name, "triangles": len(world.fixed_triangles()[0])}
        yield Metric("load", time.perf_counter() - start, "s", parameters=where)
        factors = []
        for _ in range(repeats):
            simulation.set_pose(world.start)
            start = time.perf_counter()
            _drive(simulation, [(0.1, 1.0, seconds)])
            factors.append(seconds / (time.perf_counter() - start))
        rates = {"lidar [Hz]": 5, "physics [Hz]": simulation.parameters.physics_rate}
        yield metric_of("real time factor, driving", factors, "", **where, **rates)
        yield Metric(
            "physics steps", float(np.median(factors)) * simulation.parameters.physics_rate, "1/s", parameters=where
        )
        frame, lidar = simulation.base.frame(), simulation.lidar
        yield time_call(
            "scan of 360 beams", lambda: lidar.scan(frame, 0.0, simulation.faults), 100 * repeats, "ms", **where
        )


def _drive(simulation: Simulation, commands: Sequence[Command]) -> float:
    """Drive and return how far (rad) the robot truly turned, whole turns included."""
    rate = simulation.parameters.physics_rate
    turned, last = 0.0, simulation.true_pose.theta
    for speed, turn, duration in commands:
        for step in range(round(duration * rate)):
            if step % round(COMMAND_PERIOD * rate) == 0:
                simulation.set_command(Twist2D(speed, 0.0, turn))
                heading = simulation.true_pose.theta
                turned, last = turned + angle_between(last, heading), heading
            simulation.step()
        simulation.set_command(Twist2D(0.0, 0.0, 0.0))
    return turned + angle_between(last, simulation.true_pose.theta)


def _trueness(name: str, commands: List[Command]) -> Iterator[Metric]:
    """Drive without looking and compare where the robot is with where it was sent, and with what its wheels say."""
    asked, asked_turn = IDENTITY, 0.0
    for speed, turn, duration in commands:
        asked = asked.compose(Pose2D(speed * duration, 0.0, turn * duration))
        asked_turn += turn * duration
    errors: List[float] = []
    turns: List[float] = []
    drifts: List[float] = []
    for seed in range(5):
        with Simulation(load_world("empty"), SimulationParameters(), seed) as simulation:
            turned = _drive(simulation, list(commands) + [(0.0, 0.0, 1.0)])
            end, odometry = simulation.true_pose, simulation.odometry_pose
        errors.append(end.distance_to(asked))
        turns.append(math.degrees(abs(turned - asked_turn)))
        drifts.append(odometry.distance_to(end))
    where = {"drive": name}
    yield metric_of("true end from where it was sent", errors, "m", **where)
    yield metric_of("true turn from the one commanded", turns, "deg", **where)
    yield metric_of("odometry's end from the true one", drifts, "m", **where)


def _cpu_share(seconds: float) -> Iterator[Metric]:
    """Run the node at real time, driven and listened to, and measure its share of a core."""
    if shutil.which("rosmaster") is None:
        return
    import rosgraph

    with tempfile.TemporaryDirectory() as folder:
        port = free_port()
        environment = {**os.environ, "ROS_MASTER_URI": f"http://localhost:{port}", "ROS_LOG_DIR": folder}
        quiet = dict(env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        master = subprocess.Popen(["rosmaster", "--core", "-p", str(port)], **quiet)
        processes = [master]
        try:
            _wait_for(lambda: rosgraph.is_master_online(environment["ROS_MASTER_URI"]))
            node = subprocess.Popen([sys.executable, str(SIMULATOR), "__name:=simulator"], **quiet)
            processes += [node, subprocess.Popen(LISTENER, **quiet), subprocess.Popen(DRIVER, **quiet)]
            time.sleep(5.0)
            if node.poll() is not None:
                raise NotMeasurable(f"the simulator node ended at once with status {node.returncode}")
            before, start = cpu_seconds(node.pid), time.monotonic()
            time.sleep(seconds)
            share = 100.0 * (cpu_seconds(node.pid) - before) / (time.monotonic() - start)
            where = {"world": "arena", "for [s]": seconds, "driving": True}
            yield Metric("CPU share of the node at real time", share, "% of a core", parameters=where)
        finally:
            for process in reversed(processes):
                process.terminate()
                process.wait(20.0)


def _wait_for(condition: Callable[[], bool], patience: float = 20.0) -> None:
    end = time.monotonic() + patience
    while not condition():
        if time.monotonic() > end:
            raise NotMeasurable("the ROS master did not start")
        time.sleep(0.1)

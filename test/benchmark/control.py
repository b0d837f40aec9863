"""Control: the time of a cycle, and how calmly and quickly each controller drives paths on paper."""

from __future__ import annotations

import math
from typing import Any, Dict, Iterator, List, Mapping, Tuple

import numpy as np

from benchmark.metric import Metric, time_call
from mbf_relay.control import CONTROLLERS
from mbf_relay.control.controller import Controller
from mbf_relay.control.state import ControlState
from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.costmap.outline import padded, radii
from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D
from mbf_relay.grid import Grid
from mbf_relay.lockstep.settings import config_folder, load_settings
from mbf_relay.lockstep.smoothness import smoothness
from mbf_relay.outcomes import ControlError
from mbf_relay.planning.path import Path
from mbf_relay.plugins import create

BURGER = padded(np.array([[-0.105, -0.105], [-0.105, 0.105], [0.041, 0.105], [0.041, -0.105]]), 0.01)
CELLS, RESOLUTION = 120, 0.025
POSTS = ((0.5, 0.3), (0.9, -0.25), (-0.4, 0.5), (0.3, -0.6), (1.2, 0.2), (-0.7, -0.2))
SAMPLES: Mapping[str, Tuple[int, int]] = {"20 x 40": (20, 40), "100 x 100": (100, 100)}
PERIOD = 0.1


def metrics(quick: bool) -> Iterator[Metric]:
    """Yield the time of cycles, and metrics of drives."""
    repeats = 20 if quick else 200
    for label, (along, turns) in SAMPLES.items():
        for speed, turn in ((0.2, 0.0), (0.2, 0.8)):
            call, count = _cycle(along, turns, speed, turn)
            yield time_call(
                "one cycle of DWA", call, repeats, warm_up=3, sampled=label, trajectories=count, sim_time=1.5,
                speed=speed, turn=turn, costmap=f"{CELLS} x {CELLS}",
            )
    call, _ = _cycle(1, 1, 0.2, 0.0, "PurePursuit")
    yield time_call("one cycle of pure pursuit", call, repeats, warm_up=3, costmap=f"{CELLS} x {CELLS}")
    call, _ = _cycle(1, 1, 0.2, 0.0, "MPPI")
    yield time_call("one cycle of MPPI", call, repeats, warm_up=3, drives=1000, steps=56, costmap=f"{CELLS} x {CELLS}")
    for name in ("DWAPlannerROS", "PurePursuit", "MPPI"):
        for path_name, path in _paths().items():
            yield from _drive(name, path_name, path)


def make(name: str, **changes: Any) -> Controller:
    """Return a controller of the server's parameter file, by its name there."""
    server = load_settings(config_folder())["move_base_flex"]
    type_name = next(entry["type"] for entry in server["controllers"] if entry["name"] == name)
    return create(name, type_name, {**server[name], **changes}, Controller, CONTROLLERS)


def costmap_with(posts: Tuple[Tuple[float, float], ...] = POSTS) -> CostGrid:
    """Return the local costmap of a robot at the origin among posts (m), inflated as the tutorials do."""
    grid = Grid(RESOLUTION, -CELLS * RESOLUTION / 2.0, -CELLS * RESOLUTION / 2.0, CELLS, CELLS)
    y, x = np.mgrid[:CELLS, :CELLS]
    distance = np.full(grid.shape, math.inf)
    for post in posts:
        column, row = grid.cell_at(*post)
        distance = np.minimum(distance, np.hypot(x - column, y - row))
    inscribed, circumscribed = radii(BURGER)
    metres = distance * RESOLUTION
    costs = np.where(metres <= 1.0, 252.0 * np.exp(-3.0 * (metres - inscribed)), 0.0)
    costs = np.where(metres <= inscribed, 253.0, np.minimum(costs, 252.0)).astype(np.uint8)
    costs[distance == 0.0] = 254
    return CostGrid(grid, np.ascontiguousarray(costs), "odom", BURGER, inscribed, circumscribed, tracks=())


def _cycle(along: int, turns: int, speed: float, turn: float, name: str = "DWAPlannerROS") -> Tuple[Any, int]:
    """Return a call that runs one cycle of a moving robot, and how many trajectories that scores."""
    sampled = {"vx_samples": along, "vth_samples": turns, "turn_to_path_angle": 4.0}
    changes: Dict[str, Any] = sampled if name == "DWAPlannerROS" else {}
    controller = make(name, **changes)
    controller.set_path(_line((0.0, 0.0), (1.4, 0.3)), True)
    costmap, clock = costmap_with(), [0.0]

    def call() -> None:
        clock[0] += 1.0  # so that each cycle starts from the velocity given
        controller.compute_velocity(
            ControlState(clock[0], Pose2D(0.0, 0.0, 0.0), Twist2D(speed, 0.0, turn), costmap, IDENTITY, PERIOD))

    call()
    explanation = getattr(controller, "explanation", None)
    return call, len(explanation.velocities) - 1 if explanation is not None else 0


def _line(*corners: Tuple[float, float]) -> Path:
    points: List[np.ndarray] = []
    for start, end in zip(np.array(corners)[:-1], np.array(corners)[1:]):
        count = max(1, int(np.hypot(*(end - start)) / 0.025))
        points.extend(start + (end - start) * i / count for i in range(count))
    places = np.array(points + [np.array(corners[-1])])
    steps = np.diff(places, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    return Path(np.column_stack((places, np.append(headings, headings[-1]))), "odom")


def _paths() -> Dict[str, Path]:
    wave = np.linspace(0.0, 4.0, 200)
    places = np.column_stack((wave, 0.3 * np.sin(1.5 * wave)))
    steps = np.diff(places, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    return {
        "straight, 3 m": _line((0.0, 0.0), (3.0, 0.0)),
        "right angle": _line((0.0, 0.0), (1.5, 0.0), (1.5, 1.5)),
        "behind": _line((0.0, 0.0), (-1.5, 0.0)),
        "wave": Path(np.column_stack((places, np.append(headings, headings[-1]))), "odom"),
    }


def _drive(name: str, path_name: str, path: Path) -> Iterator[Metric]:
    """Yield metrics of one drive without obstacles by a robot that follows commands at 1 m/s^2."""
    controller, pose, velocity = make(name), Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0)
    controller.set_path(path, True)
    commands, off, length, cycle = [], [], 0.0, 0
    for cycle in range(600):
        moved = CostGrid(*_free_costmap(pose), tracks=())
        state = ControlState(cycle * PERIOD, pose, velocity, moved, IDENTITY, PERIOD)
        if controller.is_goal_reached(state):
            break
        try:
            command = controller.compute_velocity(state)
        except ControlError:
            command = Twist2D(0.0, 0.0, 0.0)
        for _ in range(10):
            change = 1.0 * PERIOD / 10.0
            velocity = Twist2D(velocity.x + min(change, max(-change, command.x - velocity.x)), 0.0, command.theta)
            step = pose.compose(Pose2D(velocity.x * 0.01, 0.0, velocity.theta * 0.01))
            length += step.distance_to(pose)
            pose = step
        commands.append((command.x, command.theta))
        off.append(float(np.hypot(*(path.poses[:, :2] - pose[:2]).T).min()))
    values = np.array(commands)
    calm = smoothness(np.arange(len(values)) * PERIOD, values[:, 0], values[:, 1], length)
    where = dict(controller=name, path=path_name)
    yield Metric("time over the ideal", cycle * PERIOD / (path.length / 0.22), parameters=where)
    yield Metric("changes of turning side", calm.turn_changes_per_metre, "/m", parameters=where)
    yield Metric("mean jerk", calm.mean_jerk, "m/s3", parameters=where)
    yield Metric("largest distance off the path", max(off), "m", parameters=where)
    yield Metric("final error", pose.distance_to(path.goal), "m", parameters=where)


def _free_costmap(pose: Pose2D) -> Tuple[Any, ...]:
    size = CELLS * RESOLUTION / 2.0
    grid = Grid(RESOLUTION, pose.x - size, pose.y - size, CELLS, CELLS)
    inscribed, circumscribed = radii(BURGER)
    return grid, np.zeros(grid.shape, np.uint8), "odom", BURGER, inscribed, circumscribed

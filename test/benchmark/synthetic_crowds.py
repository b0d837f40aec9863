"""Made worlds in which things move: crowds that stray, and lanes to cross, for the batch runner.

    python3 -m benchmark.synthetic_crowds --movers 10 --seeds 1 20 > crowd_10.json

A mover goes to and fro between two points, heeds nobody, and never comes where the robot starts or is to arrive.
Whoever changes anything for drives through worlds of odd seeds judges it by those of even ones.
"""

from __future__ import annotations

import argparse
import json
from typing import Any, Dict, List, Sequence

import numpy as np

LENGTH, HALF_WIDTH = 6.0, 1.5
"""Metres from the start to the goal, and from the way between them to the walls."""

QUIET = 0.8
"""Metres round start and goal that no mover enters."""

SPEEDS, RADII, HEIGHT = (0.1, 0.3), (0.06, 0.15), 0.5


def crowd(movers: int, seed: int) -> Dict[str, Any]:
    """Return a world with so many that stray in all directions."""
    rng = np.random.default_rng([seed, movers])
    return _world(f"crowd_{movers}_{seed}", [_stray(rng) for _ in range(movers)])


def lanes(scale: float, seed: int) -> Dict[str, Any]:
    """Return a world with four lanes across the way, the movers in each `scale` times as fast and as wide as elsewhere.
    """
    rng = np.random.default_rng([seed, round(1000 * scale)])
    found = []
    for x in np.linspace(1.2, LENGTH - 1.2, 4):
        radius, speed = scale * rng.uniform(*RADII), scale * rng.uniform(*SPEEDS)
        side = HALF_WIDTH - 0.1 - radius
        found += [_mover(rng, (x, -side), (x, side), radius, speed)]
    return _world(f"lanes_{scale:g}_{seed}", found)


def _stray(rng: np.random.Generator) -> Dict[str, Any]:
    radius, speed = rng.uniform(*RADII), rng.uniform(*SPEEDS)
    low = np.array([QUIET + radius, -HALF_WIDTH + 0.1 + radius])
    high = np.array([LENGTH - QUIET - radius, HALF_WIDTH - 0.1 - radius])
    start = rng.uniform(low, high)
    end = rng.uniform(low, high)
    while np.hypot(*(end - start)) < 1.2:
        end = rng.uniform(low, high)
    return _mover(rng, start, end, radius, speed)


def _mover(
    rng: np.random.Generator, start: Sequence[float], end: Sequence[float], radius: float, speed: float
) -> Dict[str, Any]:
    """Return a mover that begins anywhere between two points, on its way to either."""
    one, two = np.array(start), np.array(end)
    if rng.random() < 0.5:
        one, two = two, one
    begin = one + rng.random() * (two - one)
    times = np.cumsum([0.0, np.hypot(*(two - begin)), np.hypot(*(two - one)), np.hypot(*(begin - one))]) / speed
    rows = [
        [round(float(value), 4) for value in (time, *place)] for time, place in zip(times, (begin, two, one, begin))
    ]
    return {"radius": round(float(radius), 4), "height": HEIGHT, "waypoints": rows, "loop": True}


def _world(name: str, movers: List[Dict[str, Any]]) -> Dict[str, Any]:
    walls = [[LENGTH / 2.0, side * HALF_WIDTH, 0.0, LENGTH + 1.2, 0.1, 0.5] for side in (-1.0, 1.0)]
    walls += [[x, 0.0, 0.0, 0.1, 2.0 * HALF_WIDTH, 0.5] for x in (-0.6, LENGTH + 0.6)]
    named = [{"name": f"mover_{index}", **mover} for index, mover in enumerate(movers)]
    return {
        "name": name, "start": [0.0, 0.0, 0.0], "goal": [LENGTH, 0.0, 0.0], "goal_radius": 0.2,
        "reference_path_length": LENGTH, "time_limit": 150.0, "boxes": walls, "movers": named,
    }


def main() -> None:
    """Write a worlds file."""
    parser = argparse.ArgumentParser(prog="synthetic_crowds", description="Make worlds in which things move.")
    parser.add_argument("--movers", type=int, default=10, help="how many stray in each world; 0 for lanes")
    parser.add_argument("--scale", type=float, default=1.0, help="of the lanes' movers")
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 10), metavar=("FIRST", "LAST"))
    options = parser.parse_args()
    seeds = range(options.seeds[0], options.seeds[1] + 1)
    worlds = [crowd(options.movers, seed) if options.movers else lanes(options.scale, seed) for seed in seeds]
    print(json.dumps({"worlds": worlds}))


if __name__ == "__main__":
    main()

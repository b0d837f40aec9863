"""Made worlds in which things move: crowds that stray, lanes to cross, open fields, for the batch runner.

    python3 -m benchmark.synthetic_crowds --movers 10 --seeds 1 20 > crowd_10.json
    python3 -m benchmark.synthetic_crowds --field hard --seeds 1 20 > field_hard.json

A mover goes to and fro on its way, heeds nobody, and never comes where the robot starts or is to arrive.
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

FIELD_LENGTH, FIELD_HALF_WIDTH = 8.0, 3.0
LEVELS = {"easy": ((4, 7), (0.1, 0.2)), "medium": ((8, 12), (0.15, 0.35)), "hard": ((12, 18), (0.2, 0.5)),
          "dense": ((18, 22), (0.07, 0.33))}
"""How many movers an open field has, and their speeds (m/s): a burger's top speed is 0.22."""


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


def field(level: str, seed: int) -> Dict[str, Any]:
    """Return an open field with movers on curves of third order, each at a pace that changes on its way.

    Source: Nair, Jiang, Hou, Xu, Li, Xiao, Stone, "DynaBARN: benchmarking metric ground navigation in dynamic
    environments" (SSRR 2022), for what makes such a world harder: more movers, faster, less alike, and curves.
    """
    (fewest, most), (slowest, fastest) = LEVELS[level]
    rng = np.random.default_rng([seed, list(LEVELS).index(level), 7])
    movers = []
    for _ in range(int(rng.integers(fewest, most + 1))):
        radius, speed = rng.uniform(*RADII), rng.uniform(slowest, fastest)
        low = np.array([QUIET + radius, -FIELD_HALF_WIDTH + 0.1 + radius])
        high = np.array([FIELD_LENGTH - QUIET - radius, FIELD_HALF_WIDTH - 0.1 - radius])
        start, end = (np.array([rng.uniform(low[0], high[0]), side]) for side in (low[1], high[1]))
        shares = np.linspace(0.0, 1.0, 25)
        bend = rng.uniform(-2.0, 2.0, 2) * FIELD_HALF_WIDTH  # x bends, y goes straight through
        curve = start + shares[:, None] * (end - start)
        curve[:, 0] += shares * (1.0 - shares) * (bend[0] + bend[1] * (2.0 * shares - 1.0))
        curve = np.clip(curve, low, high)
        paces = speed * (1.0 + rng.uniform(0.0, 0.5) * np.sin(2.0 * np.pi * (shares[1:] + rng.random())))
        movers.append(_along(rng, curve, np.hypot(*np.diff(curve, axis=0).T) / paces, radius))
    return _world(f"field_{level}_{seed}", movers, FIELD_LENGTH, FIELD_HALF_WIDTH)


def _along(rng: np.random.Generator, way: np.ndarray, durations: np.ndarray, radius: float) -> Dict[str, Any]:
    """Return a mover that begins anywhere on a way to and fro, of shape (N, 2), of such durations (s)."""
    there_and_back = np.vstack((way, way[-2::-1]))
    times = np.cumsum(np.concatenate(([0.0], durations, durations[::-1])))
    first = int(rng.integers(len(there_and_back) - 1))
    rows = [
        [round(float((time - times[first]) % times[-1]), 4), *np.round(place, 4).tolist()]
        for time, place in zip(times[:-1], there_and_back[:-1])
    ]
    rows.sort(key=lambda row: row[0])
    rows.append([round(float(times[-1]), 4), *rows[0][1:]])
    return {"radius": round(float(radius), 4), "height": HEIGHT, "waypoints": rows, "loop": True}


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
    rows = {
        round(float(time), 4): np.round(place, 4).tolist() for time, place in zip(times, (begin, two, one, begin))
    }  # by their times, which rise: who begins at an end has come to it before it sets out
    waypoints = [[time, *place] for time, place in rows.items()]
    return {"radius": round(float(radius), 4), "height": HEIGHT, "waypoints": waypoints, "loop": True}


def _world(
    name: str, movers: List[Dict[str, Any]], length: float = LENGTH, half_width: float = HALF_WIDTH
) -> Dict[str, Any]:
    walls = [[length / 2.0, side * half_width, 0.0, length + 1.2, 0.1, 0.5] for side in (-1.0, 1.0)]
    walls += [[x, 0.0, 0.0, 0.1, 2.0 * half_width, 0.5] for x in (-0.6, length + 0.6)]
    named = [{"name": f"mover_{index}", **mover} for index, mover in enumerate(movers)]
    return {
        "name": name, "start": [0.0, 0.0, 0.0], "goal": [length, 0.0, 0.0], "goal_radius": 0.2,
        "reference_path_length": length, "time_limit": 150.0, "boxes": walls, "movers": named,
    }


def main() -> None:
    """Write a worlds file."""
    parser = argparse.ArgumentParser(prog="synthetic_crowds", description="Make worlds in which things move.")
    parser.add_argument("--movers", type=int, default=10, help="how many stray in each world; 0 for lanes")
    parser.add_argument("--field", choices=LEVELS, help="open fields of this level instead")
    parser.add_argument("--scale", type=float, default=1.0, help="of the lanes' movers")
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 10), metavar=("FIRST", "LAST"))
    parser.add_argument("--step", type=int, default=1, help="from seed to seed: 2 for odd ones, or even ones, alone")
    options = parser.parse_args()
    worlds = []
    for seed in range(options.seeds[0], options.seeds[1] + 1, options.step):
        if options.field:
            worlds.append(field(options.field, seed))
        else:
            worlds.append(crowd(options.movers, seed) if options.movers else lanes(options.scale, seed))
    print(json.dumps({"worlds": worlds}))


if __name__ == "__main__":
    main()

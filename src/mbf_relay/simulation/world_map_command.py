"""The world_to_map command: draws the map of a world, in map_server's format."""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from typing import List, Optional

from mbf_relay.commands import finite, positive
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.maps import COARSEST, FINEST, save_map, too_large
from mbf_relay.simulation.floor import leveled
from mbf_relay.simulation.world_map import SCAN_HEIGHT, grid_around, map_of_world
from mbf_relay.simulation.worlds import load_world


def main(arguments: Optional[List[str]] = None) -> int:
    """Write the map; return the exit status: 0, or 1 after an error, which is printed as one line."""
    options = _parser().parse_args(arguments)
    try:
        if not FINEST <= options.resolution <= COARSEST:
            raise ValueError(f"--resolution is {options.resolution:g} m; it must be {FINEST:g} to {COARSEST:g} m")
        world = load_world(options.world, options.world_name)
        if options.start:
            x, y = options.start
            world = leveled(replace(world, start=Pose2D(x, y, 0.0)))
        if options.size:
            grid = Grid(options.resolution, *options.origin, *options.size)
        else:
            grid = grid_around(world, options.resolution, height=options.height)
        trouble = too_large(grid.width, grid.height)
        if trouble:
            raise ValueError(f"the map would have {trouble}: give a coarser --resolution")
        folder = os.path.dirname(os.path.abspath(options.output))
        os.makedirs(folder, exist_ok=True)
        paths = save_map(options.output, map_of_world(world, grid, options.height))
    except (ValueError, OSError) as error:
        print(f"world_to_map.py: {error}", file=sys.stderr)
        return 1
    for warning in world.warnings:
        print(f"world_to_map.py: {warning}", file=sys.stderr)
    print(f"wrote {paths[0]} and {paths[1]}: {grid.width} x {grid.height} cells of {grid.resolution} m")
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="world_to_map.py", description="Draw the map of a world from its geometry.")
    parser.add_argument("world", help="arena, empty, or a world's file, as the simulator takes it")
    parser.add_argument("output", help="the map's path without ending; NAME.yaml and NAME.pgm are written")
    parser.add_argument(
        "--world-name", default="", help="name of the world, in a file with several (default: the first)")
    parser.add_argument(
        "--start", type=finite, nargs=2, metavar=("X", "Y"),
        help="robot's start in metres, which is free space; default: the world's own start, or 0 0",
    )
    parser.add_argument("--resolution", type=float, default=0.05, help="side of a cell in metres (default 0.05)")
    parser.add_argument(
        "--origin",
        type=finite,
        nargs=2,
        default=(-10.0, -10.0),
        metavar=("X", "Y"),
        help="lower left corner in metres, with --size (default -10 -10)",
    )
    parser.add_argument(
        "--size", type=positive, nargs=2, metavar=("COLUMNS", "ROWS"),
        help="number of cells; default: the map fits the world"
    )
    parser.add_argument(
        "--height",
        type=finite,
        default=SCAN_HEIGHT,
        help=f"of the cut in metres ({SCAN_HEIGHT:.3f}, the burger's lidar)",
    )
    return parser

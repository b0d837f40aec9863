"""localize_log.py: replay a recorded log without ROS, and say how far it was off."""

from __future__ import annotations

import argparse
import csv
import json
import os
import sys
import time
from typing import Any, Dict, List, Mapping, Optional, Tuple

import numpy as np

from mbf_relay import files
from mbf_relay.geometry import Pose2D
from mbf_relay.localization.logs import RecordedLog, load_log
from mbf_relay.localization.node_parameters import AmclParameters, initial_pose_from
from mbf_relay.localization.replay import Replay, replay, summarize
from mbf_relay.maps import OccupancyMap, load_map


def parse_arguments(arguments: Optional[List[str]] = None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(
        prog="localize_log.py",
        description=__doc__,
        epilog="LOG.npz holds t (N), odom (N, 3: x, y, yaw), ranges (N, B), angle_min, angle_increment, and where "
        "known "
        "ref (N, 3), laser_pose (3) and range_max. bag_to_log.py makes one from a bag.",
    )
    parser.add_argument("log", metavar="LOG.npz")
    parser.add_argument("map", metavar="MAP.yaml")
    parser.add_argument("--params", metavar="FILE", help="amcl's parameters (YAML); its defaults where not given")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the filter's chance (default 0)")
    parser.add_argument("--out", metavar="DIR", help="where to write (default: LOG_localized)")
    start = parser.add_mutually_exclusive_group()
    start.add_argument(
        "--start", type=float, nargs=3, metavar=("X", "Y", "YAW"),
        help="pose at the first scan (default: the log's first ref, else initial_pose_* of the parameters)",
    )
    start.add_argument("--global-localization", action="store_true", help="start anywhere on the map")
    return parser.parse_args(arguments)


def read_parameters(path: Optional[str]) -> Tuple[AmclParameters, Mapping[str, Any]]:
    """Return amcl's parameters from a YAML file, flat or under `amcl:`, and the file's values.

    Raises:
        OSError: The file cannot be opened.
        ValueError: It is no YAML of parameters, or a value is wrong; the text names it.
    """
    if path is None:
        return AmclParameters(), {}
    try:
        values = files.parse_yaml(files.read_text(path)) or {}
    except ValueError as error:
        raise ValueError(f"parameter file {path} is no YAML: {error}") from error
    if not isinstance(values, dict):
        raise ValueError(f"parameter file {path} holds {type(values).__name__}; it must hold names and values")
    values = values.get("amcl", values.get("/amcl", values))
    try:
        return AmclParameters.from_mapping(values), values
    except ValueError as error:
        raise ValueError(f"parameter file {path}: {error}") from error


def choose_start(
    options: argparse.Namespace, values: Mapping[str, Any], log: RecordedLog
) -> Tuple[Optional[Pose2D], np.ndarray]:
    """Return the pose to start at, None for anywhere, and its covariance, shape (3, 3)."""
    pose, covariance, _ = initial_pose_from(values)
    if options.global_localization:
        return None, covariance
    if options.start is not None:
        return Pose2D(*options.start), covariance
    if log.reference is not None and np.isfinite(log.reference[0]).all():
        return Pose2D(*map(float, log.reference[0])), covariance
    return pose, covariance


def write_results(
    folder: str, log: RecordedLog, occupancy: OccupancyMap, result: Replay, figures: Dict[str, Any]
) -> None:
    """Write trajectory.csv, result.json and result.png into a folder; OSError where that fails."""
    from mbf_relay.localization.replay_plot import draw_replay

    os.makedirs(folder, exist_ok=True)
    with open(os.path.join(folder, "trajectory.csv"), "w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "x", "y", "yaw", "updated", "seconds"])
        for stamp, pose, updated, seconds in zip(log.times, result.poses, result.updated, result.seconds):
            writer.writerow([f"{stamp:.6f}", *(f"{value:.6f}" for value in pose), int(updated), f"{seconds:.6f}"])
    with open(os.path.join(folder, "result.json"), "w", encoding="utf-8") as file:
        json.dump(figures, file, indent=2)
        file.write("\n")
    draw_replay(os.path.join(folder, "result.png"), log, occupancy, result)


def describe(figures: Mapping[str, Any]) -> List[str]:
    """Return the figures as lines for a person."""
    lines = [f"{figures['scans']} scans, {figures['updates']} updates"]
    for name, unit, factor in (
        ("translation_error", "m", 1.0), ("rotation_error", "deg", 180.0 / np.pi), ("seconds_per_update", "ms", 1e3),
    ):
        if name in figures:
            spread = ", ".join(f"{key} {factor * value:.3f}" for key, value in figures[name].items())
            lines.append(f"{name.replace('seconds', 'time').replace('_', ' ')} [{unit}]: {spread}")
    if "lost_share" in figures:
        lines.append(f"share of scans off by more than 1 m: {figures['lost_share']:.3f}")
    return lines


def main(arguments: Optional[List[str]] = None) -> int:
    """Run the command; return its exit status."""
    options = parse_arguments(arguments)
    try:
        log, occupancy = load_log(options.log), load_map(options.map)
        parameters, values = read_parameters(options.params)
        start, covariance = choose_start(options, values, log)
        result = replay(
            log, occupancy, parameters, np.random.default_rng(options.seed), start, covariance, clock=time.perf_counter
        )
        figures = {**summarize(result, log), "seed": options.seed, "log": options.log, "map": options.map}
        folder = options.out or os.path.splitext(os.path.basename(options.log))[0] + "_localized"
        write_results(folder, log, occupancy, result, figures)
    except (OSError, ValueError) as error:
        print(f"localize_log.py: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    print("\n".join(describe(figures) + [f"written to {folder}"]))
    return 0

"""localize_log.py: replay recorded logs without ROS, and say how far they were off."""

from __future__ import annotations

import argparse
import csv
import io
import json
import os
import sys
import time
from dataclasses import fields
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

import numpy as np

from mbf_relay import files
from mbf_relay.commands import positive, random_seed
from mbf_relay.geometry import Pose2D, degrees_told
from mbf_relay.localization.logs import RecordedLog, doubts_on_times, load_log
from mbf_relay.localization.node_parameters import (
    INITIAL,
    NODE_ONLY,
    AmclParameters,
    initial_pose_from,
    require_initial_pose,
)
from mbf_relay.localization.replay import Replay, replay, require_use, summarize
from mbf_relay.localization.stress import Stress, parse_stress
from mbf_relay.localization.trials import LogTask, as_json, run, summarize_trials, table
from mbf_relay.maps import OccupancyMap, load_map
from mbf_relay.whole_files import write_whole


def parse_arguments(arguments: Optional[List[str]] = None) -> argparse.Namespace:
    """Return the options of the command line."""
    parser = argparse.ArgumentParser(
        prog="localize_log.py",
        description=__doc__,
        epilog="LOG.npz holds t (N, seconds), odom (N, 3: x, y, yaw), ranges (N, B), angle_min, angle_increment, and "
        "where known ref (N, 3), laser_pose (3), range_min and range_max. bag_to_log.py makes one from a bag. With "
        "several logs or seeds, or under stress, a table with 95 % intervals is made. Stresses: "
        f"{', '.join(describe_stresses())}.",
    )
    parser.add_argument(
        "files", metavar="FILE", nargs="+", help="LOG.npz ... MAP.yaml: one or more logs followed by their map; "
        "repeat for further maps",
    )
    parser.add_argument("--params", metavar="FILE", help="amcl's parameters, a YAML file (default: amcl's defaults)")
    parser.add_argument("--seed", type=random_seed, default=0, metavar="N", help="seed of the filter (default 0)")
    parser.add_argument(
        "--seeds", type=positive, default=1, metavar="N", help="number of seeds to run, from --seed on (default 1)")
    parser.add_argument(
        "--stress", action="append", default=[], metavar="NAME=NUMBER,...",
        help="also replay the logs under stress, e.g. unmapped=0.3,range_max=3.5; may be repeated",
    )
    parser.add_argument(
        "--out", metavar="DIR",
        help="folder for results (default: LOG_localized); with several logs, seeds or stresses, which write nothing "
        "by default, for the table as trials.json",
    )
    start = parser.add_mutually_exclusive_group()
    start.add_argument(
        "--start", type=float, nargs=3, metavar=("X", "Y", "YAW"),
        help="pose at the first scan (default: the log's first ref, else initial_pose_* of the parameters)",
    )
    start.add_argument("--global-localization", action="store_true", help="start with particles all over the map")
    return parser.parse_args(arguments)


def describe_stresses() -> List[str]:
    """Return the names of stresses, each with what it means."""
    return [f"{field.name} ({field.metadata['description']})" for field in fields(Stress)]


def pair_up(paths: Sequence[str]) -> List[Tuple[str, str]]:
    """Return each log with the map that follows it, each such pair once.

    Raises:
        ValueError: A log has no map after it, or there is no log.
    """
    pairs: List[Tuple[str, str]] = []
    waiting: List[str] = []
    for path in paths:
        if path.endswith((".yaml", ".yml")):
            pairs += [(log, path) for log in waiting]
            waiting = []
        else:
            waiting.append(path)
    if waiting or not pairs:
        raise ValueError(
            f"log {waiting[0]} has no map; name its MAP.yaml after it" if waiting else f"there is no log in {paths[0]}"
        )
    return list(dict.fromkeys(pairs))


def read_log(path: str) -> RecordedLog:
    """Return a log, errors as of `load_log`; tell where its times are not those of a drive."""
    log = load_log(path)
    for doubt in doubts_on_times(log):
        print(f"localize_log.py: log {path}: {doubt}; jumps of its odometry may be taken for driving", file=sys.stderr)
    return log


def read_parameters(path: Optional[str]) -> Tuple[AmclParameters, Mapping[str, Any]]:
    """Return amcl's parameters from a YAML file, flat or under `amcl:`, and the file's values; tell what is not known.

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
    if isinstance(values, dict):
        values = values.get("amcl", values.get("/amcl", values)) or {}
    if not isinstance(values, dict):
        raise ValueError(f"parameter file {path} holds {type(values).__name__}; it must hold names and values")
    for name in AmclParameters.unknown_names(values):
        if name not in (*INITIAL, *NODE_ONLY):
            hint = AmclParameters.hint(name)
            print(f"localize_log.py: parameter file {path}: {name} is not known here{hint}", file=sys.stderr)
    try:
        require_initial_pose(values)
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
    """Write trajectory.csv, result.json and result.png into a folder that exists; OSError where that fails."""
    from mbf_relay.localization.replay_plot import draw_replay

    rows = io.StringIO(newline="")
    writer = csv.writer(rows)
    writer.writerow(["t", "x", "y", "yaw", "updated", "seconds"])
    for stamp, pose, updated, seconds in zip(log.times, result.poses, result.updated, result.seconds):
        writer.writerow([f"{stamp:.6f}", *(f"{value:.6f}" for value in pose), int(updated), f"{seconds:.6f}"])
    write_whole(os.path.join(folder, "trajectory.csv"), rows.getvalue())
    write_whole(os.path.join(folder, "result.json"), json.dumps(figures, indent=2) + "\n")
    draw_replay(os.path.join(folder, "result.png"), log, occupancy, result)


def describe(figures: Mapping[str, Any]) -> List[str]:
    """Return the figures as lines for a person."""
    lines = [f"{figures['scans']} scans, {figures['updates']} updates"]
    if figures["unusable"]:
        lines.append(f"nothing could be used of {figures['unusable']} scans, or of the odometry with them")
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
    told = degrees_told(options.start[2]) if options.start is not None else ""
    if told:
        print(f"localize_log.py: the yaw of --start {told}", file=sys.stderr)
    try:
        pairs = pair_up(options.files)
        stresses = list(dict.fromkeys([Stress(), *map(parse_stress, options.stress)]))
        many = len(pairs) > 1 or options.seeds > 1 or len(stresses) > 1
        lines = try_all(options, pairs, stresses) if many else replay_one(options, *pairs[0])
    except (OSError, ValueError) as error:
        print(f"localize_log.py: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    print("\n".join(lines))
    return 0


def replay_one(options: argparse.Namespace, log_path: str, map_path: str) -> List[str]:
    """Replay one log once, write everything about it, and return what a person is told."""
    log, occupancy = read_log(log_path), load_map(map_path)
    parameters, values = read_parameters(options.params)
    start, covariance = choose_start(options, values, log)
    folder = options.out or os.path.splitext(os.path.basename(log_path))[0] + "_localized"
    os.makedirs(folder, exist_ok=True)  # refused now, not after a long replay
    result = replay(
        log, occupancy, parameters, np.random.default_rng(options.seed), start, covariance, clock=time.perf_counter
    )
    require_use(result, log_path)
    figures = {**summarize(result, log), "seed": options.seed, "log": log_path, "map": map_path}
    write_results(folder, log, occupancy, result, figures)
    return describe(figures) + [f"written to {folder}"]


def try_all(options: argparse.Namespace, pairs: Sequence[Tuple[str, str]], stresses: Sequence[Stress]) -> List[str]:
    """Try all logs with all seeds under all stresses, and return a table; it is written where --out says so."""
    parameters, values = read_parameters(options.params)
    seeds, done = range(options.seed, options.seed + options.seeds), []
    names = [log_path for log_path, _ in pairs]
    if options.out:
        os.makedirs(options.out, exist_ok=True)  # refused now, not after long trials
    for log_path, map_path in pairs:
        log, occupancy = read_log(log_path), load_map(map_path)
        start, covariance = choose_start(options, values, log)
        name = log_path if names.count(log_path) == 1 else f"{log_path} on {map_path}"
        task = LogTask(name, log, occupancy, start, covariance)
        done += list(run(task, parameters, stresses, seeds))
    rows = summarize_trials(done)
    if options.out:
        write_whole(os.path.join(options.out, "trials.json"), json.dumps(as_json(rows), indent=2) + "\n")
    return table(rows).split("\n")

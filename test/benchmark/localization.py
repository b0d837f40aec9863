"""Localization: how near, found from anywhere, found after a kidnapping, kept on rough drives, and how fast."""

from __future__ import annotations

import math
import os
from typing import Iterator, List, NamedTuple, Optional

import numpy as np
import yaml

from benchmark import pose_reliability, step_lengths
from benchmark.arena import arena_map
from benchmark.held_out import START_COVARIANCE, held_out_drives
from benchmark.metric import Metric, metric_of, time_call
from benchmark.synthetic_buildings import BUILDINGS, FAMILIAR
from benchmark.synthetic_drives import Rough, as_map, make_drive, spoil_odometry, wander
from mbf_relay.geometry import IDENTITY, Pose2D, angle_between
from mbf_relay.localization.distance_field import DistanceField, distances_to
from mbf_relay.localization.estimate import estimate
from mbf_relay.localization.laser_kernels import cast_scan
from mbf_relay.localization.laser_models import make_laser_model
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.motion_models import make_motion_model
from mbf_relay.localization.node_parameters import AmclParameters
from mbf_relay.localization.replay import LOST_FROM, errors, replay
from mbf_relay.localization.resampling import particle_limits, resample
from mbf_relay.localization.scan_search import ScanSearch
from mbf_relay.localization.tracker import START_MARGIN
from mbf_relay.lockstep.episodes import EpisodeJob
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.lockstep.setup import make_setup
from mbf_relay.lockstep.tasks import circle
from mbf_relay.lockstep.workers import run
from mbf_relay.maps import OccupancyMap
from mbf_relay.scan import LaserScan

FOUND_WITHIN, FOUND_TURN = 0.25, 0.25
STAYS_FOUND = 5
"""Updates in a row that must be near the truth before the robot counts as found."""
USUAL_NOISE = Rough(step=0.22, odometry=0.02, slips=0.0)


def metrics(quick: bool) -> Iterator[Metric]:
    """Yield all metrics of localization."""
    yield from on_circles(3 if quick else 10)
    yield from searches(8 if quick else 50)
    yield from rough_drives(1 if quick else 6)
    yield from held_out_drives(1 if quick else 5)
    yield from pose_reliability.metrics(*((1, 2) if quick else (2,)))
    yield from step_lengths.metrics(2 if quick else len(BUILDINGS))
    yield from ten_times_the_noise(2 if quick else 10)
    yield from speed(5 if quick else 30)


def burger_parameters() -> AmclParameters:
    """Return amcl's parameters as the package configures the burger."""
    return AmclParameters.from_mapping(yaml.safe_load((config_folder() / "amcl.yaml").read_text(encoding="utf-8")))


def on_circles(count: int) -> Iterator[Metric]:
    """Drive the tutorial's circle with amcl and yield the errors against the simulation's truth."""
    setup = make_setup(config_folder())
    results = run([EpisodeJob(circle(), setup, seed) for seed in range(1, count + 1)], os.cpu_count() or 1)
    yield metric_of("circle: position error, mean", [r.localization_error_mean for r in results], "m", seeds=count)
    yield Metric("circle: position error, max", max(r.localization_error_max for r in results), "m", repeats=count)
    degrees = [math.degrees(r.heading_error_mean) for r in results]
    yield metric_of("circle: heading error, mean", degrees, "deg", seeds=count)


class Search(NamedTuple):
    """A search for the robot: metres driven until found, None where it was not; error (m) at the end."""

    driven: Optional[float]
    error: float


def searches(count: int) -> Iterator[Metric]:
    """Start anywhere, and be carried off while driving; yield how often and how soon the robot was found."""
    parameters = burger_parameters()
    recovering = parameters.replace(recovery_alpha_slow=0.001, recovery_alpha_fast=0.1)
    for name, values, kidnapped in (("global localization", parameters, False), ("kidnapping", recovering, True)):
        found = [search(arena_map(), values, seed, kidnapped) for seed in range(count)]
        metres = [one.driven for one in found if one.driven is not None]
        yield Metric(f"{name}: found", 100.0 * len(metres) / count, "%", repeats=count, parameters={"within": "10 m"})
        if metres:
            yield metric_of(f"{name}: metres until found", metres, "m", found=len(metres))


def search(
    occupancy: OccupancyMap, parameters: AmclParameters, seed: int, kidnapped: bool, metres: float = 10.0
) -> Search:
    """Search for a burger in a map while it wanders about.

    Args:
        occupancy: The map; it is the world, too.
        parameters: Of the filter.
        seed: Of the drive and the filter.
        kidnapped: Carry it somewhere else after it was tracked for two metres; else start anywhere.
        metres: How far it drives before the search is given up.
    """
    rng = np.random.default_rng(seed)
    field = DistanceField(occupancy, 2.0)
    scans = int(metres / USUAL_NOISE.step)
    localizer = Localizer(parameters, occupancy, np.random.default_rng(seed))
    if kidnapped:
        before = wander(field, 10, USUAL_NOISE.step, rng)
        localizer.set_initial_pose(before[0], START_COVARIANCE)
        odom = drive(localizer, field, before, IDENTITY, rng).last_odom
    else:
        localizer.globalize()
        odom = IDENTITY
    result = drive(localizer, field, wander(field, scans, USUAL_NOISE.step, rng), odom, rng)
    return Search(result.found_after, result.error)


class Driven(NamedTuple):
    """A drive: odometry at its end, metres until the filter was right and stayed so, error (m) at the end."""

    last_odom: Pose2D
    found_after: Optional[float]
    error: float


def drive(
    localizer: Localizer, field: DistanceField, way: List[Pose2D], odom: Pose2D, rng: np.random.Generator
) -> Driven:
    """Drive a way with the burger's lidar, from an odometry pose on."""
    spoiled = spoil_odometry(np.array(way), USUAL_NOISE, rng)
    bearings = np.arange(360) * (2.0 * math.pi / 360.0)
    ranges, driven, right, found, pose = np.empty(360), 0.0, 0, None, odom
    for index, truth in enumerate(way):
        pose = odom.compose(Pose2D(*map(float, spoiled[index])))
        cast_scan(np.array([truth]), field.blocked, field.frame, 3.5, bearings, ranges)
        noisy = np.where(ranges < 3.5, ranges + rng.normal(0.0, 0.01, 360), np.inf)
        localizer.process(pose, LaserScan(noisy, 0.0, bearings[1], 0.12, 3.5, float(index)), IDENTITY)
        driven += truth.distance_to(way[index - 1]) if index else 0.0
        believed = localizer.map_from_odom.compose(pose) if localizer.map_from_odom else IDENTITY
        near = (
            believed.distance_to(truth) < FOUND_WITHIN and abs(angle_between(believed.theta, truth.theta)) < FOUND_TURN
        )
        right = right + 1 if near else 0
        found = (driven if found is None else found) if near and (found is not None or right) else None
    return Driven(pose, found if right >= STAYS_FOUND else None, believed.distance_to(way[-1]))


def rough_drives(seeds: int) -> Iterator[Metric]:
    """Replay made drives with sparse scans, bad odometry, missing walls and people, as we do it and as amcl does."""
    for name, robust in (("rough going", True), ("rough going, robust off", False)):
        parameters = AmclParameters(robust=robust)
        off, kept = [], []
        for building in FAMILIAR:
            for seed in range(seeds):
                made = make_drive(building, 200, Rough(), np.random.default_rng(seed))
                start = Pose2D(*map(float, made.log.reference[0]))
                result = replay(
                    made.log, made.occupancy, parameters, np.random.default_rng(seed), start, START_COVARIANCE
                )
                distances = errors(result.poses, made.log.reference)["translation"]
                off.append(float(np.median(distances)))
                kept.append(100.0 * float((distances < LOST_FROM).mean()))
        drives = {"drives": len(off), "buildings": ", ".join(FAMILIAR)}
        yield metric_of(f"{name}: median error of a drive", off, "m", **drives)
        yield Metric(f"{name}: scans on track", float(np.mean(kept)), "%", repeats=len(kept), parameters=drives)


def ten_times_the_noise(count: int) -> Iterator[Metric]:
    """Wander through the arena with ten times the usual odometry noise; yield whether the robot was kept."""
    kept, field, parameters = 0, DistanceField(arena_map(), 2.0), burger_parameters()
    for seed in range(count):
        rng = np.random.default_rng(seed)
        way = wander(field, 60, USUAL_NOISE.step, rng)
        localizer = Localizer(parameters, arena_map(), rng)
        localizer.set_initial_pose(way[0], START_COVARIANCE)
        spoiled = spoil_odometry(np.array(way), USUAL_NOISE._replace(odometry=10.0 * USUAL_NOISE.odometry), rng)
        bearings, ranges = np.arange(360) * (2.0 * math.pi / 360.0), np.empty(360)
        for index, truth in enumerate(way):
            cast_scan(np.array([truth]), field.blocked, field.frame, 3.5, bearings, ranges)
            scan = LaserScan(np.where(ranges < 3.5, ranges, np.inf), 0.0, bearings[1], 0.12, 3.5, float(index))
            localizer.process(Pose2D(*map(float, spoiled[index])), scan, IDENTITY)
        kept += localizer.map_from_odom.compose(Pose2D(*map(float, spoiled[-1]))).distance_to(way[-1]) < FOUND_WITHIN
    yield Metric("kept at ten times the odometry noise", 100.0 * kept / count, "%", repeats=count)


def speed(repeats: int) -> Iterator[Metric]:
    """Time the stages of an update at several numbers of particles, and the distance field of a large map."""
    occupancy, rng = arena_map(), np.random.default_rng(1)
    field, scan = DistanceField(occupancy, 2.0), _arena_scan(occupancy)
    for count in (500, 2000, 5000, 50000):
        poses = np.array([-2.0, -0.5, 0.0]) + rng.normal(0.0, 0.2, (count, 3))
        weights = rng.random(count)
        weights /= weights.sum()
        for beams in (60, 180):
            model = make_laser_model(field, AmclParameters(laser_max_beams=beams))
            picked = model.pick(scan, IDENTITY)
            yield time_call(
                f"reweight {count} x {beams}",
                lambda: model.log_likelihoods(poses, picked),
                repeats,
                particles=count,
                beams=beams,
            )
        motion = make_motion_model(AmclParameters())
        step = (IDENTITY, Pose2D(0.2, 0.0, 0.1))
        yield time_call(f"propagate {count}", lambda: motion.propagate(poses, *step, rng), repeats, particles=count)
        limits = particle_limits(count, count, 0.01, 0.99)
        yield time_call(f"resample {count}", lambda: resample(poses, weights, limits, rng), repeats, particles=count)
        yield time_call(f"estimate {count}", lambda: estimate(poses, weights), repeats, particles=count)
    yield from _whole_updates(occupancy, scan, repeats)
    yield from _one_scan_searches(max(3, repeats // 5))
    walls = np.zeros((4000, 4000), dtype=bool)
    walls[rng.integers(0, 4000, 40000), rng.integers(0, 4000, 40000)] = True
    yield time_call("distance field 4000 x 4000", lambda: distances_to(walls, 0.05, 2.0), max(3, repeats // 5))


def _whole_updates(occupancy: OccupancyMap, scan: LaserScan, repeats: int) -> Iterator[Metric]:
    for robust in (False, True):
        parameters = burger_parameters().replace(robust=robust, min_particles=3000, update_min_d=0.0, update_min_a=0.0)
        localizer = Localizer(parameters, occupancy, np.random.default_rng(1))
        localizer.set_initial_pose(Pose2D(-2.0, -0.5, 0.0), START_COVARIANCE)

        def update() -> None:
            localizer.request_update()
            localizer.process(IDENTITY, scan, IDENTITY)

        yield time_call(
            "whole update, robust" if robust else "whole update", update, repeats, particles=3000, beams=180
        )


def _one_scan_searches(repeats: int) -> Iterator[Metric]:
    """Look for a scan of a building, and for one that fits nowhere, on a map of 64 x 60 m."""
    rng = np.random.default_rng(1)
    walls = np.block([[BUILDINGS["office"](rng) for _ in range(2)] for _ in range(3)])
    field = DistanceField(as_map(walls), 2.0)
    search, bearings, seen = ScanSearch(field), np.arange(180) * (2.0 * math.pi / 180.0), np.empty(180)
    cast_scan(field.random_free_poses(1, rng), field.blocked, field.frame, 20.0, bearings, seen)
    for name, ranges in (("one-scan search", seen), ("one-scan search, fits nowhere", rng.uniform(0.3, 8.0, 180))):
        hits = np.column_stack((ranges * np.cos(bearings), ranges * np.sin(bearings)))
        yield time_call(name, lambda: search.search(hits, margin=START_MARGIN), repeats, cells=walls.size)


def _arena_scan(occupancy: OccupancyMap) -> LaserScan:
    field, ranges = DistanceField(occupancy, 2.0), np.empty(360)
    bearings = np.arange(360) * (2.0 * math.pi / 360.0)
    cast_scan(np.array([[-2.0, -0.5, 0.0]]), field.blocked, field.frame, 3.5, bearings, ranges)
    return LaserScan(np.where(ranges < 3.5, ranges, np.inf), 0.0, bearings[1], 0.12, 3.5, 0.0)

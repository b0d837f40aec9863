"""Public robots by their own navigation parameters, each with a body and wheels by its file's footprint and limits.

What a file does not say of a robot is made up as any builder would: wheels near the corners, a lidar on top.
"""

import copy
import dataclasses
import functools
import math
from pathlib import Path

import numpy as np

from mbf_relay import files
from mbf_relay.costmap.outline import footprint_from_radius, parse_footprint
from mbf_relay.geometry import Pose2D, convex_hull
from mbf_relay.lockstep.setup import KNOWN, TRUTH, Setup
from mbf_relay.lockstep.tasks import EpisodeTask, task_of
from mbf_relay.navigation.examination import examine_move_base
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.generators import generate
from mbf_relay.simulation.robot import CAR
from mbf_relay.simulation.robot_file import robot_of
from mbf_relay.simulation.shapes import Body, Box
from mbf_relay.simulation.world import World
from mbf_relay.simulation.worlds_file import world_of

SETS = files.parse_yaml((Path(__file__).parent / "zoo.yaml").read_text(encoding="utf-8"))
NAMES = sorted(SETS)
SPEEDS = ("max_vel_trans", "max_trans_vel", "max_vel_x", "max_vel_lin", "max_speed_xy")
TURNS = ("max_vel_theta", "max_rot_vel", "max_rotational_vel", "max_vel_th")
ROOM = 12.0
LIDAR_HEIGHT = 0.25
SLACK = 0.01
"""Metres by which the solid robot is smaller than its footprint."""


@functools.lru_cache(maxsize=None)
def examined(name):
    """Return the examination of a robot's parameters."""
    return examine_move_base(SETS[name]["parameters"])


def footprint_of(config):
    """Return the local costmap's footprint, shape (K, 2) in metres."""
    local = {**config, **config.get("local_costmap", {})}
    if local.get("footprint") not in (None, [], "[]"):
        return parse_footprint(local["footprint"])
    return footprint_from_radius(local.get("robot_radius", 0.46))


def limits_of(config):
    """Return top speed and turn rate of the controller's group."""
    group = config.get(config["controllers"][0]["name"], {})
    return (
        max([float(group[name]) for name in SPEEDS if name in group] or [0.55]),
        max([abs(float(group[name])) for name in TURNS if name in group] or [1.0]),
    )


def robot_for(name, config):
    """Return the robot of a set, and the simulator's parameters for it."""
    footprint = convex_hull(footprint_of(config))
    (back, right), (front, left) = footprint.min(axis=0), footprint.max(axis=0)
    speed, turn = limits_of(config)
    drive, width, length = SETS[name]["drive"], left - right, front - back
    radius = 0.12 * min(width, length)
    group = config.get(config["controllers"][0]["name"], {})
    solid = footprint - np.sign(footprint) * np.minimum(SLACK, np.abs(footprint))
    wheels = dict(radius=radius, width=0.1 * radius, mass=1.0, separation=0.6 * min(width, length))
    wheels["base"] = 0.6 * length if drive != "differential" else 0.0
    if drive == CAR:
        wheels.update(base=0.6 * front, turning_radius=float(group["min_turning_radius"]), steering_rate=3.0)
    casters = [{"at": [0.8 * x, 0.0], "radius": 0.3 * radius, "mass": 0.1} for x in (back, front)]
    values = dict(
        drive=drive, base_height=radius, wheels=wheels, casters=[] if wheels["base"] else casters,
        body=[dict(polygon=solid.tolist(), height=0.2, at=[0.0, 0.0, 0.11 - 0.5 * radius], mass=20.0)],
        lidar=dict(at=[0.0, 0.0, LIDAR_HEIGHT - radius]), footprint=footprint.tolist(),
    )
    simulator = dict(
        max_speed=1.05 * speed, max_turn_rate=1.05 * turn, wheel_acceleration=3.0, wheel_torque=200.0, scan_rate=10,
        scan_beams=360, scan_range_max=10.0, scan_resolution=0.0, scan_noise=0.005,
    )
    return robot_of(name, values), simulator


def setup_for(name):
    """Return a lockstep setup in which the robot drives by its own parameters, in this graph's frames."""
    config = copy.deepcopy(examined(name).config)
    config.update(global_frame="map", robot_frame="base_footprint")
    for side, frame in (("global_costmap", "map"), ("local_costmap", config["local_costmap"].get("global_frame", ""))):
        frame = "map" if frame.strip("/").endswith("map") else "odom"
        config[side] = {**config.get(side, {}), "global_frame": frame, "robot_base_frame": "base_footprint"}
        take_scans(config[side])
    robot, simulator = robot_for(name, config)
    settings = {"simulator": simulator, "amcl": {"laser_max_range": 10.0}, "move_base_flex": config}
    return Setup(settings, TRUTH, KNOWN, robot=robot)


def take_scans(group):
    """Have every sensor of a costmap be the one lidar there is here, a bumper near the floor too."""
    for value in group.values():
        if isinstance(value, dict):
            take_scans(value)
    if "data_type" in group:
        group["data_type"] = "LaserScan"
        group["min_obstacle_height"] = min(group.get("min_obstacle_height", 0.0), LIDAR_HEIGHT)
        group["max_obstacle_height"] = max(group.get("max_obstacle_height", 2.0), LIDAR_HEIGHT)


def through_field(name, seed):
    """Return the task: through a generated field of obstacles, as large as the robot is beside the burger."""
    burger = footprint_of(examined("turtlebot3_burger").config).ptp(axis=0).max()
    scale = max(1.0, float(footprint_of(examined(name).config).ptp(axis=0).mean() / burger))
    task = task_of(world_of(Path("generated"), 0, generate("barn", seed))).scaled(scale)
    return dataclasses.replace(task, time_limit=300.0)


def there_and_back(name):
    """Return the task: 1.5 m ahead, a turn, and back; a car comes back on a circle it can drive."""
    half = ROOM / 2.0
    walls = [
        Body(f"wall_{index}", Box((0.2, ROOM, 1.0)), Frame.of(
            half * math.cos(turn), half * math.sin(turn), 0.5, yaw=turn))
        for index, turn in enumerate((0.0, math.pi / 2.0, math.pi, -math.pi / 2.0))
    ]
    goals = (Pose2D(1.5, 0.0, 0.0), Pose2D(1.5, 0.0, 1.6), Pose2D(0.0, 0.0, 3.1))
    if SETS[name]["drive"] == CAR:
        goals = (Pose2D(1.5, 0.0, 0.0), Pose2D(3.0, 1.5, 1.57), Pose2D(1.5, 3.0, 3.14), Pose2D(0.0, 3.0, 3.14))
    start = Pose2D(-0.5, -0.5, 0.0) if SETS[name]["drive"] == CAR else Pose2D(0.0, 0.0, 0.0)
    return EpisodeTask(name, World(name, tuple(walls), start), goals, 120.0)

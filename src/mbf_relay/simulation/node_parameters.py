"""Parameters of the simulator node: those of the simulation, and of the node."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Dict, List, Mapping, Optional

from mbf_relay.geometry import Pose2D
from mbf_relay.parameters import parameter
from mbf_relay.simulation.floor import leveled
from mbf_relay.simulation.parameters import SimulationParameters, steps_between
from mbf_relay.simulation.robot_file import load_robot
from mbf_relay.simulation.world import World


@dataclass(frozen=True)
class SimulatorParameters(SimulationParameters):
    """Parameters of the `simulator` node."""

    world: str = parameter(
        "arena", "arena, empty, or a file: map YAML, SDF or Gazebo world, URDF, or worlds file (JSON)")
    world_name: str = parameter("", "name of the world, in a file with several; empty for the first")
    x_pos: Optional[float] = parameter(
        None, "x of the robot's start in the map frame; if not set, the world's own start", unit="m")
    y_pos: Optional[float] = parameter(
        None, "y of the robot's start in the map frame; if not set, the world's own start", unit="m")
    yaw: Optional[float] = parameter(
        None, "heading at the robot's start in the map frame; if not set, the world's own start", unit="rad")
    seed: int = parameter(1, "seed of all noise; equal seeds give equal readings", minimum=0)
    gui: bool = parameter(False, "open PyBullet's window")

    real_time_factor: float = parameter(
        1.0, "simulated seconds per second of wall time; 0 for as fast as possible", minimum=0.0)
    follow_clock: bool = parameter(False, "follow the /clock of another simulator instead of publishing it")
    neighbours: str = parameter(
        "", "namespaces of other simulators whose robots are obstacles in this world, separated by spaces")
    clock_rate: float = parameter(60.0, "rate of /clock, in simulated time", unit="Hz", above=0.0)
    truth_rate: float = parameter(30.0, "rate of the true pose, in simulated time; 0 for none", unit="Hz", minimum=0.0)
    command_patience: float = parameter(
        0.0, "longest wall time to wait before a scan for the velocity command that answers the last one; 0 to not "
        "wait", unit="s", minimum=0.0, aliases=("hold",))

    picture_folder: str = parameter("", "folder of take_pictures' files; empty for ROS's log folder")

    world_frame: str = parameter(
        "map", "frame of the true pose, of obstacles and of poses the robot is set to", is_frame=True)
    odom_frame: str = parameter("odom", "frame of the odometry", is_frame=True)
    base_frame: str = parameter("base_footprint", "frame of the robot's base on the ground", is_frame=True)
    scan_frame: str = parameter("base_scan", "frame of the lidar", is_frame=True)
    imu_frame: str = parameter("imu_link", "frame of the inertial sensor", is_frame=True)
    publish_odom_tf: bool = parameter(True, "publish odometry on /tf too")

    @classmethod
    def known(cls, values: Mapping[str, Any]) -> Dict[str, Any]:
        """Return the values for this set: the user's, else those of the robot's file, with the names of its frames."""
        own = super().known(values)
        return {**(load_robot(str(own["robot"])).frames if "robot" in own else {}), **own}

    def check(self) -> None:
        """Raise ValueError where a rate does not divide the physics rate."""
        super().check()
        for name in ("clock_rate", "truth_rate"):
            steps_between(name, getattr(self, name), self.physics_rate)

    def placed(self, world: World) -> World:
        """Return the world with the start by x_pos, y_pos and yaw, and a warning if that is outside of all bodies."""
        asked = (self.x_pos, self.y_pos, self.yaw)
        start = Pose2D(*(own if value is None else value for own, value in zip(world.start, asked)))
        return leveled(replace(world, start=start, warnings=(*world.warnings, *_beside(world, start))))


def _beside(world: World, start: Pose2D) -> List[str]:
    """Return a warning if a start that the user has set lies outside of the bounding box of all fixed bodies."""
    places = world.fixed_triangles()[0].reshape(-1, 3)[:, :2]
    if start == world.start or not len(places):
        return []
    (left, below), (right, above) = places.min(axis=0), places.max(axis=0)
    if left <= start.x <= right and below <= start.y <= above:
        return []
    return [
        f"the robot starts at ({start.x:.2f}, {start.y:.2f}), beside all that stands there, which is between "
        f"({left:.2f}, {below:.2f}) and ({right:.2f}, {above:.2f}): look at x_pos and y_pos"]

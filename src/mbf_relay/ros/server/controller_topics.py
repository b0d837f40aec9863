"""A controller's topics (global_plan, local_plan, clouds, explanation) and its dynamic_reconfigure server."""

from __future__ import annotations

import numpy as np
import rospy
from nav_msgs.msg import Path as PathMessage
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

from mbf_relay.control.controller import Controller
from mbf_relay.control.report import CycleReport
from mbf_relay.navigation.registry import Registry
from mbf_relay.planning.path import Path
from mbf_relay.ros.common import reconfigure
from mbf_relay.ros.common.clouds import cloud_message
from mbf_relay.ros.common.conversions import path_to_message


class ControllerTopics:
    """Publishes each cycle of a controller on ~NAME/..., each topic only while it has subscribers.

    Topics: `global_plan` (the path ahead, within the local costmap), `local_plan` (the trajectory of the command; empty
    while the robot turns in place), `cost_cloud` and `trajectory_cloud` (with publish_cost_grid_pc, publish_traj_pc),
    all as dwa_local_planner's, and `explanation` (text).
    """

    def __init__(self, controller: Controller) -> None:
        name = controller.name
        self._global_plan = rospy.Publisher(f"~{name}/global_plan", PathMessage, queue_size=1)
        self._local_plan = rospy.Publisher(f"~{name}/local_plan", PathMessage, queue_size=1)
        self._cost_cloud = rospy.Publisher(f"~{name}/cost_cloud", PointCloud2, queue_size=1)
        self._trajectory_cloud = rospy.Publisher(f"~{name}/trajectory_cloud", PointCloud2, queue_size=1)
        self._explanation = rospy.Publisher(f"~{name}/explanation", String, queue_size=1)
        controller.watcher = self.publish

    def publish(self, report: CycleReport) -> None:
        """Publish a cycle; called in the controller's thread."""
        frame = report.costmap.frame
        if _heard(self._global_plan):
            self._global_plan.publish(path_to_message(Path(report.path_ahead(), frame), report.now))
        if _heard(self._local_plan):
            self._local_plan.publish(path_to_message(Path(report.trajectory, frame), report.now))
        if report.explanation is not None and _heard(self._explanation):
            self._explanation.publish(str(report.explanation))
        if report.cost_weights is not None and _heard(self._cost_cloud):
            self._cost_cloud.publish(_cost_cloud(report))
        if report.shows_trajectories and report.trajectories is not None and _heard(self._trajectory_cloud):
            self._trajectory_cloud.publish(_trajectory_cloud(report))


def serve_controllers(controllers: Registry[Controller]) -> None:
    """Advertise the topics and reconfigure servers of all controllers."""
    for name in controllers.names:
        serve_controller(controllers, name)


def serve_controller(controllers: Registry[Controller], name: str) -> None:
    """Advertise the topics and, where it has one, the reconfigure server of a controller."""
    ControllerTopics(controllers.plugin(name))
    reconfigure.serve_plugin(controllers, name)


def _heard(publisher: rospy.Publisher) -> bool:
    return bool(publisher.get_num_connections())


def _cost_cloud(report: CycleReport) -> PointCloud2:
    """Return the cost of each free cell: x, y, z, path_cost, goal_cost, occ_cost, total_cost."""
    centers, costs = report.cell_costs()
    points = np.column_stack((centers, np.zeros(len(centers)), costs, costs @ np.array(report.cost_weights)))
    names = ("x", "y", "z", "path_cost", "goal_cost", "occ_cost", "total_cost")
    return cloud_message(names, points, report.costmap.frame, report.now)


def _trajectory_cloud(report: CycleReport) -> PointCloud2:
    """Return the poses of all trajectories that were not ruled out: x, y, z, theta, cost."""
    batch, totals = report.trajectories, report.totals
    assert batch is not None and totals is not None
    kept = np.flatnonzero(np.isfinite(totals))
    counts = batch.free[kept]
    rows = np.repeat(kept, counts)
    steps = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    poses = batch.poses[rows, steps]
    points = np.column_stack((poses[:, :2], np.zeros(len(poses)), poses[:, 2], totals[rows]))
    return cloud_message(("x", "y", "z", "theta", "cost"), points, report.costmap.frame, report.now)

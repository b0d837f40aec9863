"""nav_msgs/GetPlan as move_base's callers use it: quaternions of zeros, and a plan that ends at the goal."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import PoseStamped, Quaternion


def with_orientation(pose: PoseStamped) -> PoseStamped:
    """Return the pose, with the identity in place of an all-zero quaternion.

    move_base's planners ignore orientations, so callers leave them at zeros.
    """
    q = pose.pose.orientation
    if q.x or q.y or q.z or q.w:
        return pose
    result = PoseStamped(header=pose.header)
    result.pose.position, result.pose.orientation = pose.pose.position, Quaternion(0.0, 0.0, 0.0, 1.0)
    return result


def append_goal(plan: Any, goal: PoseStamped) -> None:
    """Append the goal to a nav_msgs/Path that ends within the tolerance but not at the goal, as move_base does."""
    if not plan.poses or plan.poses[-1].header.frame_id not in ("", goal.header.frame_id):
        return
    last, wanted = plan.poses[-1].pose.position, goal.pose.position
    if max(abs(last.x - wanted.x), abs(last.y - wanted.y)) > 1e-6:
        plan.poses.append(goal)

"""One robot on the page: turns its messages into layers; only messages that are shown are deserialized."""

from __future__ import annotations

import math
import time
from functools import partial
from typing import Any, Dict, List, Optional, Tuple

import numpy as np
import rospy
from actionlib_msgs.msg import GoalStatus

from mbf_relay.geometry import Pose2D
from mbf_relay.ros.common.conversions import pose_from_message, twist_from_message
from mbf_relay.ros.web import readers
from mbf_relay.ros.web.listening import Listening
from mbf_relay.view.layers import Journal, Newest, ViewLayer
from mbf_relay.view.points import points_part
from mbf_relay.view.story import GoalStory
from mbf_relay.view.tiles import TiledGrid

LIMITS = {"scan": 1500, "particles": 600, "global_plan": 400, "local_plan": 200, "footprint": 60, "trajectories": 4000}
"""Most points of a layer; more cannot be told apart on a screen."""
PERIODS = {
    "scan": 0.1,
    "particles": 0.5,
    "global_plan": 0.25,
    "local_plan": 0.2,
    "footprint": 0.2,
    "trajectories": 0.25,
}
"""Least time (s) between two updates of a layer."""
GRIDS = ("map", "global_costmap", "local_costmap")
GOAL_STATES = {GoalStatus.SUCCEEDED: "reached", GoalStatus.PREEMPTED: "cancelled", GoalStatus.RECALLED: "cancelled"}
RUNNING = (GoalStatus.PENDING, GoalStatus.ACTIVE, GoalStatus.PREEMPTING, GoalStatus.RECALLING)
SILENCE = 3.0
"""Time (s) without move_base/status after which move_base counts as gone; it publishes at 5 Hz."""
STALE_AFTER = 5.0
"""Wall time (s) without a message after which a diagnostic status counts as stale, as in diagnostic_aggregator."""
STALE = 3
"""DiagnosticStatus.STALE."""
SHOWN_DIAGNOSTICS = 60
SHOWN_OBSTACLES = 500


class RobotView:
    """The layers of one robot; used only in the event loop's thread.

    Args:
        listening: The robot's subscriptions.
        map_frame: Frame in which everything is drawn.

    Attributes:
        layers: Layers by name.
        story: Progress of the current or last goal.
        ended: Id and state ("reached", "cancelled" or "failed") of goals that ended; whoever reads it empties it.
        pose: Pose of the robot in the map frame, None where unknown.
        set_down: Marker ids of the present obstacles that were set from a browser.
    """

    def __init__(self, listening: Listening, map_frame: str) -> None:
        self.listening, self._map_frame = listening, map_frame
        self.story = GoalStory()
        self.ended: List[Tuple[str, str]] = []
        self.pose: Optional[Pose2D] = None
        self.set_down: List[int] = []
        self._robot, self._obstacles = Newest("robot", 0.0), Newest("obstacles", 0.5)
        self._told, self._log = Newest("diagnostics", 1.0), Journal("log", 1.0, 50)
        self.state = Newest("state", 0.25)
        self._points = {name: Newest(name, period) for name, period in PERIODS.items()}
        self._grids = {name: TiledGrid(name, 0.3) for name in GRIDS}
        rest = (self._robot, self._obstacles, self._told, self._log, self.state)
        self.layers: Dict[str, ViewLayer] = {**self._points, **self._grids, **{layer.name: layer for layer in rest}}
        self._speed = (0.0, 0.0)
        self._error: Optional[float] = None
        self._diagnostics: Dict[str, Dict[str, Any]] = {}
        self._reported: Dict[str, float] = {}  # wall time (s) of the last message, by name
        self._fit: Tuple[str, str] = "", ""  # amcl's diagnostic status, and the scan's share that fits
        self._status_time = -math.inf
        self._ended_goal: Optional[str] = None
        self._others: List[str] = []

    def update(self, now: float) -> None:
        """Put received messages into the layers; `now` is wall time (s)."""
        for key, message in self.listening.inbox.take(now):
            try:
                getattr(self, f"_take_{key}")(message, now)
            except Exception as error:  # an invalid message must not keep the others from the page
                rospy.logwarn_throttle(
                    10.0, f"{key} of {self.listening.namespace} is not shown: {readers.short(str(error), 200)}"
                )
        self._look_for_robot()
        self._show_diagnostics(now)
        # a relay without the action publishes no status
        if self.story.state == "active" and self.tells_status and now - self._status_time > SILENCE:
            self.story.ended("failed", "move_base has fallen silent")

    def _look_for_robot(self) -> None:
        """Update the robot's pose and velocity, and the poses of the grids' frames and of other robots."""
        frames = {grid.shape.frame for grid in self._grids.values() if grid.shape is not None} - {self._map_frame}
        self.pose = self._lookup(self.listening.base_frame)
        header: Dict[str, Any] = {
            "pose": rounded(self.pose), "speed": [round(value, 3) for value in self._speed],
            "frames": {name: rounded(self._lookup(name)) for name in sorted(frames)},
        }
        if self._others:
            header["others"] = {name: rounded(self._lookup(name)) for name in self._others}
        self._robot.show(header)

    def _lookup(self, frame: str, stamp: Any = None) -> Optional[Pose2D]:
        return self.listening.lookup(self._map_frame, frame, stamp)

    @property
    def has_map(self) -> bool:
        """Whether a map was received."""
        return self._grids["map"].shape is not None

    @property
    def tells_status(self) -> bool:
        """Whether move_base has published its status, as it does if it has the action."""
        return self._status_time > -math.inf

    def look_for_others(self) -> None:
        """Find the base frames of other robots: the same name under another prefix."""
        own = self.listening.base_frame.lstrip("/")
        last = own.rsplit("/", 1)[-1]
        names = self.listening.frame_names()
        self._others = sorted(name for name in names if name.rsplit("/", 1)[-1] == last and name != own)[:20]

    def words(self, now: float) -> Dict[str, Any]:
        """Return the entries of the layer `state` that are known here; `now` is wall time (s)."""
        status, fit = self._fit
        return {
            "goal": self.story.as_dict(self.pose, now), "fit": None if self._is_stale(status, now) else fit,
            "error": self._error, "has_map": self.has_map, "move_base": now - self._status_time < SILENCE,
        }

    def _show_points(self, name: str, header: Any, points: np.ndarray) -> None:
        """Show points that are in a header's frame at its stamp."""
        self._points[name].put(partial(self._part, name, header, points))

    def _part(self, name: str, header: Any, points: np.ndarray) -> Optional[bytes]:
        placed = self._placed(header, points, name == "particles")
        return None if placed is None else points_part(name, placed, LIMITS[name])

    def _placed(self, header: Any, points: np.ndarray, turn: bool) -> Optional[np.ndarray]:
        """Return points in the map frame, None if theirs is unknown; with `turn`, the third column is a heading."""
        if header.frame_id.lstrip("/") == self._map_frame:
            return points
        place = self._lookup(header.frame_id, header.stamp)
        if place is None:
            return None
        return (
            place.transform_poses(points) if turn else np.column_stack((place.transform_points(points), points[:, 2:]))
        )

    def _take_map(self, message: Any, _now: float) -> None:
        self._take_grid("map", message)

    def _take_global_costmap(self, message: Any, _now: float) -> None:
        self._take_grid("global_costmap", message)

    def _take_local_costmap(self, message: Any, _now: float) -> None:
        self._take_grid("local_costmap", message)

    def _take_grid(self, name: str, message: Any) -> None:
        grid = message.read()
        self._grids[name].replace(readers.grid_shape(grid), grid.data)

    def _take_global_costmap_updates(self, message: Any, _now: float) -> None:
        self._take_window("global_costmap", message)

    def _take_local_costmap_updates(self, message: Any, _now: float) -> None:
        self._take_window("local_costmap", message)

    def _take_window(self, name: str, message: Any) -> None:
        update = message.read()
        if self._grids[name].shape is not None:  # else the whole grid was not received yet
            self._grids[name].update(update.x, update.y, update.width, update.data)

    def _take_scan(self, message: Any, _now: float) -> None:
        scan = message.read()
        self._show_points("scan", scan.header, readers.scan_points(scan))

    def _take_particles(self, message: Any, _now: float) -> None:
        cloud = message.read()
        self._show_points("particles", cloud.header, readers.particle_poses(cloud))

    def _take_global_plan(self, message: Any, now: float) -> None:
        path = message.read()
        points = readers.path_points(path)
        placed = self._placed(path.header, points, False)
        if placed is not None:
            self.story.planned(placed, now)
        if self.story.state == "active" and self.story.goal is None and path.poses:  # sent before anybody looked
            end = self._placed(path.header, np.array([pose_from_message(path.poses[-1].pose)]), True)
            self.story.began(None if end is None else Pose2D(*end[0]))
        self._show_points("global_plan", path.header, points)

    def _take_local_plan(self, message: Any, _now: float) -> None:
        path = message.read()
        self._show_points("local_plan", path.header, readers.path_points(path))

    def _take_trajectories(self, message: Any, _now: float) -> None:
        cloud = message.read()
        self._show_points("trajectories", cloud.header, readers.cloud_points(cloud))

    def _take_footprint(self, message: Any, _now: float) -> None:
        polygon = message.read()
        self._show_points("footprint", polygon.header, readers.polygon_points(polygon))

    def _take_obstacles(self, message: Any, _now: float) -> None:
        markers = message.read()
        self.set_down = readers.set_down(markers)
        outlines = readers.obstacle_outlines(markers, self._map_frame)
        self._obstacles.show({"outlines": outlines[:SHOWN_OBSTACLES]})

    def _take_odometry(self, message: Any, now: float) -> None:
        velocity = twist_from_message(message.read().twist.twist)
        self._speed = (velocity.x, velocity.theta)
        self.story.moves(velocity.speed(), now)

    def _take_truth(self, message: Any, _now: float) -> None:
        truth = message.read()
        if truth.header.frame_id.lstrip("/") != self._map_frame:
            return
        then = self.listening.lookup(self._map_frame, self.listening.base_frame, truth.header.stamp, or_newest=False)
        if then is not None:
            self._error = round(pose_from_message(truth.pose.pose).distance_to(then), 4)

    def _take_status(self, message: Any, now: float) -> None:
        self._status_time = now
        running = [status for status in message.read().status_list if status.status in RUNNING]
        if any(status.goal_id.id != self._ended_goal for status in running):  # results may overtake older statuses
            self.story.began(None)

    def _take_goal(self, message: Any, _now: float) -> None:
        goal = message.read()
        place = pose_from_message(goal.pose)
        frame = self._lookup(goal.header.frame_id)
        self.story.began(None if frame is None else frame.compose(place))

    def _take_result(self, message: Any, _now: float) -> None:
        status = message.read().status
        self._goal_ended(status, status.text, why="")

    def _take_outcome(self, message: Any, _now: float) -> None:
        outcome = message.read()
        self._goal_ended(outcome.status, outcome.status.text, outcome.result.message)

    def _goal_ended(self, status: GoalStatus, text: str, why: str) -> None:
        """Note a goal's end, which two topics report, in either order; only navigation_outcome gives `why`."""
        state, goal = GOAL_STATES.get(status.status, "failed"), status.goal_id.id
        is_known = goal == self._ended_goal and self.story.state == state
        if not is_known:
            self._ended_goal = goal
            self.ended.append((goal, state))
        if why or not is_known:
            self.story.ended(state, readers.short(f"{text} ({why})" if why not in ("", text) else text, 300))

    def _take_feedback(self, _message: Any, now: float) -> None:
        self.story.drove(now)

    def _take_recovery(self, message: Any, now: float) -> None:
        self.story.recovers(readers.short(message.read().recovery_behavior_name, 60), now)

    def _take_diagnostics(self, message: Any, now: float) -> None:
        for status in message.read().status:
            name = readers.short(status.name, 80)
            if name not in self._diagnostics and len(self._diagnostics) >= SHOWN_DIAGNOSTICS:
                continue
            self._diagnostics[name] = {
                "level": status.level, "name": name, "text": readers.short(status.message, 200),
            }
            self._reported[name] = now
            for pair in status.values:
                if name.endswith("amcl: scans") and pair.key.startswith("share of the scan"):
                    self._fit = name, readers.short(pair.value, 10)

    def _show_diagnostics(self, now: float) -> None:
        """Show the last message of each diagnostic status, or that it is stale, as of a node that has died."""
        if not self._diagnostics:
            return
        entries = [
            {**entry, "level": STALE, "text": f"no report for more than {STALE_AFTER:g} s; the last: {entry['text']}"}
            if self._is_stale(name, now) else entry for name, entry in self._diagnostics.items()
        ]
        self._told.show({"entries": sorted(entries, key=lambda entry: (-entry["level"], entry["name"]))})

    def _is_stale(self, status: str, now: float) -> bool:
        return now - self._reported.get(status, -math.inf) > STALE_AFTER

    def _take_log(self, message: Any, _now: float) -> None:
        entry = readers.log_entry(message.read())
        if entry is not None:
            entry["time"] = time.strftime("%H:%M:%S")
            self._log.add(entry)


def rounded(pose: Optional[Pose2D]) -> Optional[List[float]]:
    """Return a pose as a list [x, y, heading] (m, rad) of four decimals, None for None."""
    return None if pose is None else [round(value, 4) for value in pose]

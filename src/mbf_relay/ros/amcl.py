"""The amcl node: the particle filter under amcl's topics, services and parameters."""

from __future__ import annotations

import sys
import threading
import time
from typing import Any, List, Optional

import numpy as np
import rospy
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap, SetMap, SetMapRequest, SetMapResponse
from sensor_msgs.msg import LaserScan as LaserScanMessage
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.estimate import Estimate
from mbf_relay.localization.localizer import Localizer
from mbf_relay.maps import OccupancyMap
from mbf_relay.outcomes import TransformError
from mbf_relay.ros import diagnostics, parameters
from mbf_relay.localization.node_parameters import (
    INITIAL, NODE_ONLY, AmclParameters, initial_pose_as_parameters, initial_pose_from,
)
from mbf_relay.ros.complaints import Complaints
from mbf_relay.ros.conversions import InvalidMessage, header, map_from_message, pose_from_message, pose_to_message
from mbf_relay.ros.map_to_odom import MapToOdom
from mbf_relay.ros.particle_cloud import ParticleCloud
from mbf_relay.ros.scan_queue import LidarGeometry, ScanQueue
from mbf_relay.ros.transforms import TransformPublisher, Transforms

NO_SCAN_WARNING = 15.0


class AmclNode:
    """Feeds the filter and tells what it finds.

    Threads: callbacks put scans into the queue; one worker takes them and runs the filter; services and topics for the
    pose and the map change the filter. `_lock` is held for every use of the filter; while it is held the lock of
    MapToOdom may be taken, never the other way round.
    """

    def __init__(self) -> None:
        values = parameters.read_namespace("~")
        self._parameters: AmclParameters = parameters.fill(
            AmclParameters, values, "~", tuple(INITIAL) + NODE_ONLY
        ).without_slashes()
        seed = int(values.get("seed", time.time_ns() % 2 ** 31))
        rospy.loginfo("localizing with seed %d", seed)
        self._rng = np.random.default_rng(seed)
        self._lock = threading.RLock()
        self._localizer: Optional[Localizer] = None
        self._pending_pose: Optional[PoseWithCovarianceStamped] = None
        self._odom_pose: Optional[Pose2D] = None
        self._covariance = np.diag([INITIAL["initial_cov_xx"], INITIAL["initial_cov_yy"], INITIAL["initial_cov_aa"]])
        self._saved_at = -np.inf
        self._last_scan_at = time.monotonic()
        self._update_seconds = 0.0
        self.transforms = Transforms()
        self._queue = ScanQueue()
        self._geometry = LidarGeometry(self.transforms)
        self._map_to_odom = MapToOdom(TransformPublisher())
        self._pose_publisher = rospy.Publisher("amcl_pose", PoseWithCovarianceStamped, queue_size=2, latch=True)
        self._cloud_publisher = rospy.Publisher("particlecloud", PoseArray, queue_size=2, latch=True)

    def open(self) -> None:
        """Get the map and offer everything the node has."""
        self._subscribers = [
            rospy.Subscriber("initialpose", PoseWithCovarianceStamped, self._take_initial_pose, queue_size=2),
        ]
        if self._parameters.use_map_topic:
            self._subscribers.append(
                rospy.Subscriber("map", OccupancyGrid, self._take_map, queue_size=1, buff_size=1 << 24)
            )
        else:
            self._request_map()
        self._services = [
            rospy.Service("global_localization", Empty, self._globalize),
            rospy.Service("request_nomotion_update", Empty, self._request_update),
            rospy.Service("set_map", SetMap, self._set_map),
        ]
        self._reconfigure_server = self._serve_reconfigure()
        self._diagnostics = diagnostics.Diagnostics()
        self._diagnostics.add("Standard deviation", self._report)
        rospy.on_shutdown(self._save_pose)

    def run(self) -> None:
        """Subscribe to scans and work until shutdown."""
        self._subscribers.append(
            rospy.Subscriber(
                "scan", LaserScanMessage, self._queue.put, queue_size=10, buff_size=1 << 20, tcp_nodelay=True
            )
        )
        while not rospy.is_shutdown():
            for message in self._queue.take(self.is_ready, timeout=0.1):
                self.process(message)
            self._warn_without_scans()

    def _serve_reconfigure(self) -> Any:
        from mbf_relay.cfg import AMCLConfig
        from mbf_relay.ros import reconfigure

        return reconfigure.serve(AMCLConfig, self._parameters, self._reconfigure)

    def _reconfigure(self, wanted: AmclParameters) -> None:
        wanted = wanted.without_slashes()
        with self._lock:
            if self._localizer is not None:
                self._localizer.reconfigure(wanted)
            if wanted.base_frame_id != self._parameters.base_frame_id:
                self._geometry.forget()
            self._parameters = wanted
            self._configure_broadcast()

    def _configure_broadcast(self) -> None:
        values = self._parameters
        self._map_to_odom.configure(
            values.global_frame_id, values.odom_frame_id, values.transform_tolerance, values.tf_broadcast
        )

    # --- map ------------------------------------------------------------------------------------------------------

    def _request_map(self) -> None:
        complaints = Complaints()
        while not rospy.is_shutdown():
            try:
                rospy.wait_for_service("static_map", timeout=5.0)
                self._use_map(map_from_message(rospy.ServiceProxy("static_map", GetMap)().map))
                return
            except rospy.ROSInterruptException:
                raise
            except (rospy.ROSException, rospy.ServiceException, ValueError) as error:
                complaints.say(f"no map from {rospy.resolve_name('static_map')} yet, trying again: {error}")
                time.sleep(0.5)

    def _take_map(self, message: OccupancyGrid) -> None:
        with self._lock:
            if self._localizer is not None and self._parameters.first_map_only:
                return
        frame = message.header.frame_id.lstrip("/")
        if frame != self._parameters.global_frame_id:
            rospy.logwarn("the map is in frame '%s', not in global_frame_id '%s'", frame, self._parameters.global_frame_id)
        try:
            self._use_map(map_from_message(message))
        except ValueError as error:
            rospy.logwarn("map refused: %s", error)

    def _use_map(self, occupancy: OccupancyMap) -> None:
        """Give the filter a map, its first or another; ValueError where it is none to localize on."""
        with self._lock:
            if self._localizer is not None:
                self._localizer.set_map(occupancy)
                return
            localizer = Localizer(self._parameters, occupancy, self._rng)
            self._localizer = localizer
            self._configure_broadcast()
            pose, covariance, refused = initial_pose_from(parameters.read_namespace("~"))
            for name in refused:
                rospy.logwarn("parameter ~%s is no finite number and is ignored; %s is used", name, INITIAL[name])
            try:
                localizer.set_initial_pose(pose, covariance)
                self._covariance = covariance
            except ValueError as error:
                rospy.logwarn("%s; starting with particles all over the map", error)
            if self._pending_pose is not None:
                self._start_at(self._pending_pose)
                self._pending_pose = None
        height, width = occupancy.data.shape
        rospy.loginfo("localizing on a map of %d x %d cells of %.3f m", width, height, occupancy.resolution)

    def _set_map(self, request: SetMapRequest) -> SetMapResponse:
        try:
            self._use_map(map_from_message(request.map))
        except ValueError as error:
            rospy.logwarn("set_map: map refused: %s", error)
            return SetMapResponse(False)
        accepted = self._take_initial_pose(request.initial_pose, forced=self._parameters.force_update_after_set_map)
        return SetMapResponse(accepted)

    # --- pose -----------------------------------------------------------------------------------------------------

    def _take_initial_pose(self, message: PoseWithCovarianceStamped, forced: Optional[bool] = None) -> bool:
        frame = message.header.frame_id.lstrip("/")
        if not frame:
            rospy.logwarn("initial pose without a frame, taken in '%s'; always give one", self._parameters.global_frame_id)
        elif frame != self._parameters.global_frame_id:
            rospy.logwarn("initial pose in frame '%s' ignored: it must be in '%s'", frame, self._parameters.global_frame_id)
            return False
        with self._lock:
            if self._localizer is None:
                self._pending_pose = message
                return True
            started = self._start_at(message)
            if started and (self._parameters.force_update_after_initialpose if forced is None else forced):
                self._localizer.request_update()
            return started

    def _start_at(self, message: PoseWithCovarianceStamped) -> bool:
        """Start the filter at a pose, moved by what odometry has seen since its stamp; tell whether it was taken."""
        covariance = np.array(message.pose.covariance, dtype=float).reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]
        covariance[:2, 2] = covariance[2, :2] = 0.0
        try:
            pose = pose_from_message(message.pose.pose).compose(self._motion_since(message.header.stamp))
            self._localizer.set_initial_pose(pose, covariance)
        except ValueError as error:
            rospy.logwarn("initial pose refused: %s", error)
            return False
        rospy.loginfo("starting at x %.3f, y %.3f, yaw %.3f", *pose)
        return True

    def _motion_since(self, stamp: rospy.Time) -> Pose2D:
        """Return the base's motion from `stamp` to now; none where odometry does not reach back or is not there."""
        values = self._parameters
        try:
            now = self.transforms.lookup(values.odom_frame_id, values.base_frame_id)
            if stamp.is_zero():
                return Pose2D(0.0, 0.0, 0.0)
            return now.relative_to(self.transforms.lookup(values.odom_frame_id, values.base_frame_id, stamp.to_sec()))
        except TransformError:
            return Pose2D(0.0, 0.0, 0.0)

    def _globalize(self, _request: EmptyRequest) -> EmptyResponse:
        self.globalize()
        return EmptyResponse()

    def globalize(self) -> None:
        """Spread the particles over the map, where there is one."""
        with self._lock:
            if self._localizer is not None:
                try:
                    self._localizer.globalize()
                    rospy.loginfo("particles spread over the whole map")
                except ValueError as error:
                    rospy.logwarn("global_localization: %s", error)

    def pose(self) -> Optional[Pose2D]:
        """Return where the robot is on the map by the newest scan and estimate, None before them."""
        with self._lock:
            if self._localizer is None or self._localizer.map_from_odom is None or self._odom_pose is None:
                return None
            return self._localizer.map_from_odom.compose(self._odom_pose)

    def _request_update(self, _request: EmptyRequest) -> EmptyResponse:
        with self._lock:
            if self._localizer is not None:
                self._localizer.request_update()
        return EmptyResponse()

    # --- scans ----------------------------------------------------------------------------------------------------

    def is_ready(self, message: LaserScanMessage) -> bool:
        """Tell whether odometry is known at a scan's time, and where its lidar sits."""
        values = self._parameters
        return self.transforms.can_transform(
            values.odom_frame_id, values.base_frame_id, message.header.stamp.to_sec()
        ) and self.transforms.buffer.can_transform(
            values.base_frame_id, message.header.frame_id.lstrip("/"), rospy.Time(0), rospy.Duration(0)
        )

    def process(self, message: LaserScanMessage) -> None:
        """Run the filter on one scan whose transform is there, and publish what comes out."""
        self._last_scan_at = time.monotonic()
        stamp = message.header.stamp
        with self._lock:
            if self._localizer is None:
                return
            values, began = self._parameters, time.perf_counter()
            try:
                scan, laser_pose = self._geometry.scan_in_base(message, values.base_frame_id)
                self._odom_pose = self.transforms.lookup(values.odom_frame_id, values.base_frame_id, stamp.to_sec())
                estimate = self._localizer.process(self._odom_pose, scan, laser_pose)
            except (ValueError, TransformError) as error:
                rospy.logwarn_throttle(5.0, f"scan ignored: {error}")
                return
            map_from_odom, particles = self._localizer.map_from_odom, self._localizer.poses
            if map_from_odom is not None:
                self._map_to_odom.update(map_from_odom, stamp)
            if estimate is not None:
                self._update_seconds = time.perf_counter() - began
                self._covariance = estimate.covariance
        if estimate is not None:
            self._publish(estimate, particles, stamp)
        self._save_pose_in_time(stamp.to_sec())

    def _publish(self, estimate: Estimate, particles: np.ndarray, stamp: rospy.Time) -> None:
        message = PoseWithCovarianceStamped(header=header(self._parameters.global_frame_id, stamp))
        message.pose.pose = pose_to_message(estimate.pose)
        covariance = np.zeros((6, 6))
        covariance[np.ix_((0, 1, 5), (0, 1, 5))] = estimate.covariance
        message.pose.covariance = covariance.ravel().tolist()
        self._pose_publisher.publish(message)
        self._cloud_publisher.publish(ParticleCloud(header(self._parameters.global_frame_id, stamp), particles))

    def _warn_without_scans(self) -> None:
        silence = time.monotonic() - self._last_scan_at
        if silence < NO_SCAN_WARNING:
            return
        waiting = self._queue.oldest()
        topic = rospy.resolve_name("scan")
        if waiting is None:
            rospy.logwarn_throttle(NO_SCAN_WARNING, f"no scan on {topic} for {silence:.0f} s; no pose comes without")
        else:
            rospy.logwarn_throttle(
                NO_SCAN_WARNING,
                f"scans on {topic} wait for {silence:.0f} s: no transform from '{waiting.header.frame_id}' by "
                f"'{self._parameters.base_frame_id}' to '{self._parameters.odom_frame_id}' at their time",
            )

    # --- the pose kept for the next start ---------------------------------------------------------------------------

    def _save_pose_in_time(self, now: float) -> None:
        rate = self._parameters.save_pose_rate
        if rate > 0.0 and not 0.0 <= now - self._saved_at < 1.0 / rate:
            self._saved_at = now
            self._save_pose()

    def _save_pose(self) -> None:
        with self._lock:
            pose = self.pose()
            if pose is None:
                return
            values = initial_pose_as_parameters(pose, self._covariance)
        try:
            for name, value in values.items():
                rospy.set_param(f"~{name}", value)
        except (OSError, rospy.ROSException):
            rospy.logdebug("the pose could not be saved: the parameter server is gone")

    def _report(self) -> diagnostics.Report:
        values = self._parameters
        with self._lock:
            deviations = np.sqrt(np.diag(self._covariance))
            particles = 0 if self._localizer is None else len(self._localizer.poses)
        levels = (values.std_warn_level_x, values.std_warn_level_y, values.std_warn_level_yaw)
        details = {
            "std_x": deviations[0], "std_y": deviations[1], "std_yaw": deviations[2], "std_warn_level_x": levels[0],
            "std_warn_level_y": levels[1], "std_warn_level_yaw": levels[2], "particles": particles,
            "last update [ms]": f"{1e3 * self._update_seconds:.2f}",
            "map -> odom age [s]": f"{self._map_to_odom.age():.2f}",
        }
        if (deviations > levels).any():
            return diagnostics.WARN, "Too large", details
        return diagnostics.OK, "OK", details


def main() -> None:
    """Run the node on topics, or with --run-from-bag BAG [--global-localization] on a recorded bag."""
    arguments: List[str] = rospy.myargv(sys.argv)[1:]
    node = AmclNode()
    if arguments:
        from mbf_relay.ros.amcl_bag import run_from_bag

        run_from_bag(node, arguments)
        return
    node.open()
    node.run()

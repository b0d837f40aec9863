"""The amcl node: the particle filter under amcl's topics, services and parameters."""

from __future__ import annotations

import sys
import threading
import time
from typing import Callable, Optional, Tuple

import numpy as np
import rospy
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import SetMap, SetMapRequest, SetMapResponse
from sensor_msgs.msg import LaserScan as LaserScanMessage
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse, Trigger, TriggerRequest, TriggerResponse

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.cloud_scan import CloudParameters
from mbf_relay.localization.estimate import Estimate
from mbf_relay.localization.initial_pose import check_initial_pose
from mbf_relay.localization.kept_pose import KeptPose
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.node_parameters import INITIAL, NODE_ONLY, AmclParameters, seed_from
from mbf_relay.maps import OccupancyMap
from mbf_relay.outcomes import TransformError
from mbf_relay.parameters import convert
from mbf_relay.ros.amcl.belief import BeliefPublisher, describe_places
from mbf_relay.ros.amcl.cloud_input import AnyScan, CloudInput, CloudScan
from mbf_relay.ros.amcl.health import ScanWatch, deviation_report, missing_transform, stands_in_the_world
from mbf_relay.ros.amcl.initial_pose import check_frame, initial_pose_from_message, motion_since
from mbf_relay.ros.amcl.map_client import request_map, warn_of_frame
from mbf_relay.ros.amcl.map_to_odom import MapToOdom
from mbf_relay.ros.amcl.particle_cloud import ParticleCloud
from mbf_relay.ros.amcl.saved_pose import SavedPose, SavedStart
from mbf_relay.ros.amcl.usage import USAGE as USAGE  # run_node looks for it here
from mbf_relay.ros.amcl.usage import check_arguments
from mbf_relay.ros.common import diagnostics, parameters
from mbf_relay.ros.common.conversions import header, map_from_message, pose_to_message
from mbf_relay.ros.common.lidar_geometry import scan_in_base
from mbf_relay.ros.common.lidar_timings import LidarTimings
from mbf_relay.ros.common.message_queue import MessageQueue
from mbf_relay.ros.common.node import spare_what_stays
from mbf_relay.ros.common.transforms import TransformPublisher, Transforms
from mbf_relay.scan import LaserScan


class AmclNode:
    """Feeds scans to the filter and publishes its estimates.

    Threads: callbacks put scans into the queue; the main thread takes them and runs the filter; callbacks of services
    and of the topics for pose and map change the filter. `_lock` is held for every use of the filter; while it is held
    the lock of MapToOdom may be taken, never the other way round.
    """

    def __init__(self) -> None:
        values = parameters.read_namespace("~")
        parameters.warn_of_own_file_beside(AmclParameters.names())
        self._parameters = parameters.fill(AmclParameters, values, "~", (*INITIAL, *NODE_ONLY, "cloud"))
        parameters.warn_of_tf_prefix(self._parameters.base_frame_id)
        seed, note = seed_from(values, time.time_ns() % 2 ** 31)
        parameters.warn_of([note] if note else [], "~")
        rospy.loginfo("localizing with seed %d", seed)
        self._rng = np.random.default_rng(seed)
        self._lock = threading.RLock()
        self._localizer: Optional[Localizer] = None
        self._pending_pose: Optional[PoseWithCovarianceStamped] = None
        self._odom_pose: Optional[Pose2D] = None
        self._kept: Optional[KeptPose] = None  # saved pose, until the first scan
        self._covariance = np.diag([INITIAL["initial_cov_xx"], INITIAL["initial_cov_yy"], INITIAL["initial_cov_aa"]])
        self._saved_pose = SavedPose()
        self._scan_watch = ScanWatch()
        self._newest_scan: Optional[Tuple[LaserScan, Pose2D]] = None
        self._update_seconds = 0.0
        self._reliability: Optional[float] = None
        self._queue = MessageQueue()
        self.transforms = Transforms(changed=self._queue.look_again)
        self._timings = LidarTimings(self.transforms, self._frames)
        self._map_to_odom = MapToOdom(TransformPublisher())
        self._pose_publisher = rospy.Publisher("amcl_pose", PoseWithCovarianceStamped, queue_size=2, latch=True)
        self._cloud_publisher = rospy.Publisher("particlecloud", PoseArray, queue_size=2, latch=True)
        self._belief_publisher = BeliefPublisher()
        self._cloud_values = parameters.load(CloudParameters, "~cloud")
        self._start_anywhere = convert("start_anywhere", values.get("start_anywhere", False), bool)

    def open(self) -> None:
        """Get the map; advertise and subscribe to all topics and services but the scans."""
        rospy.Subscriber("initialpose", PoseWithCovarianceStamped, self._take_initial_pose, queue_size=2)
        if self._parameters.use_map_topic:
            rospy.Subscriber("map", OccupancyGrid, self._take_map, queue_size=1, buff_size=1 << 24)
        else:
            self._use_map(request_map(self._parameters.global_frame_id), self._saved_start())
        rospy.Service("global_localization", Empty, self._globalize)
        rospy.Service("request_nomotion_update", Empty, self._request_update)
        rospy.Service("set_map", SetMap, self._set_map)
        rospy.Service("~relocalize", Trigger, self._relocalize)
        self._serve_reconfigure()
        reports = diagnostics.Diagnostics()
        reports.add("Standard deviation", self._report)
        reports.add("scans", self._report_scans)
        rospy.on_shutdown(lambda: self._save_pose(self._saved_pose.save))

    def run(self) -> None:
        """Subscribe to scans and work until shutdown."""
        rospy.Subscriber(
            "scan", LaserScanMessage, self._take_scan, queue_size=10, buff_size=1 << 20, tcp_nodelay=True)
        CloudInput(self._cloud_values, self._queue, self.transforms, lambda: self._parameters.base_frame_id)
        while not rospy.is_shutdown():
            for message in self._queue.take(self.is_ready, timeout=0.1):
                self.process(message)
                self._scan_watch.worked()
            self._scan_watch.warn_of_silence(
                self._queue, lambda message: missing_transform(self.transforms, self._parameters, message))

    def _serve_reconfigure(self) -> None:
        from mbf_relay.cfg import AMCLConfig
        from mbf_relay.ros.common import reconfigure

        reconfigure.serve(AMCLConfig, self._parameters, self._reconfigure)

    def _reconfigure(self, wanted: AmclParameters) -> None:
        with self._lock:
            before, self._parameters = self._parameters, wanted
            if self._localizer is not None:
                self._localizer.reconfigure(wanted)
                if (wanted.odom_frame_id, wanted.base_frame_id) != (before.odom_frame_id, before.base_frame_id):
                    self._localizer.change_odometry()
                    self._odom_pose = None
            self._configure_broadcast()

    def _frames(self) -> Tuple[str, str]:
        return self._parameters.base_frame_id, self._parameters.odom_frame_id

    def _configure_broadcast(self) -> None:
        values = self._parameters
        self._map_to_odom.configure(
            values.global_frame_id, values.odom_frame_id, values.transform_tolerance, values.tf_broadcast)

    # --- map ------------------------------------------------------------------------------------------------------

    def _take_map(self, message: OccupancyGrid) -> None:
        try:
            if self._use_map(map_from_message(message), self._saved_start(), self._parameters.first_map_only):
                warn_of_frame(message, self._parameters.global_frame_id)
        except ValueError as error:
            rospy.logwarn("map refused: %s", error)

    def _saved_start(self) -> Optional[SavedStart]:
        """Return where to start on the first map, None if there is one; may block: call it without the lock."""
        return self._saved_pose.load() if self._localizer is None else None

    def _use_map(self, occupancy: OccupancyMap, start: Optional[SavedStart], only_first: bool = False) -> bool:
        """Give the filter its first map, or another unless `only_first`; return whether it did. ValueError if unfit."""
        with self._lock:
            if self._localizer is None:
                assert start is not None  # a filter, once made, stays
                self._start_on(occupancy, start)
            elif only_first:
                return False
            else:
                self._localizer.set_map(occupancy)
        rospy.loginfo(
            "localizing on a map of %d x %d cells of %.3f m", *occupancy.data.shape[::-1], occupancy.resolution)
        return True

    def _start_on(self, occupancy: OccupancyMap, start: SavedStart) -> None:
        """Make the filter, at the saved pose or at an initial pose that came before the map."""
        self._localizer = Localizer(self._parameters, occupancy, self._rng)
        self._configure_broadcast()
        pose, covariance, self._kept = start
        try:
            self._localizer.set_initial_pose(pose, covariance)
            self._covariance = covariance
        except ValueError as error:
            rospy.logwarn("%s; starting with particles all over the map", error)
        if self._start_anywhere:
            self.globalize()
        pending, self._pending_pose = self._pending_pose, None
        if pending is not None:
            self._take_initial_pose(pending)

    def _set_map(self, request: SetMapRequest) -> SetMapResponse:
        """Take a map and an initial pose on it, or neither if one is invalid."""
        try:
            occupancy, (pose, covariance) = map_from_message(request.map), self._read_pose(request.initial_pose)
            check_initial_pose(pose, covariance, occupancy)
            warn_of_frame(request.map, self._parameters.global_frame_id)
            start = self._saved_start()
            with self._lock:
                self._use_map(occupancy, start)
                self._start_at(pose, covariance, self._parameters.force_update_after_set_map)
        except ValueError as error:
            rospy.logwarn("set_map refused: %s", error)
            return SetMapResponse(False)
        return SetMapResponse(True)

    # --- pose -----------------------------------------------------------------------------------------------------

    def _take_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        try:
            with self._lock:
                if self._localizer is None:
                    self._pending_pose = message
                else:
                    self._start_at(*self._read_pose(message), self._parameters.force_update_after_initialpose)
        except ValueError as error:
            rospy.logwarn("initial pose refused: %s", error)

    def _read_pose(self, message: PoseWithCovarianceStamped) -> Tuple[Pose2D, np.ndarray]:
        """Return a message's pose, moved by odometry since its stamp, and covariance (3, 3); ValueError if invalid."""
        values = self._parameters
        check_frame(message, values.global_frame_id)
        motion = motion_since(message.header.stamp, self.transforms, values.odom_frame_id, values.base_frame_id)
        return initial_pose_from_message(message, motion)

    def _start_at(self, pose: Pose2D, covariance: np.ndarray, forced: bool) -> None:
        assert self._localizer is not None
        self._localizer.set_initial_pose(pose, covariance)
        self._kept = None
        if forced:
            self._localizer.request_update()
        rospy.loginfo("starting at x %.3f, y %.3f, yaw %.3f", *pose)

    def _globalize(self, _request: EmptyRequest) -> EmptyResponse:
        self.globalize()
        return EmptyResponse()

    def globalize(self) -> None:
        """Spread the particles over the map, where there is one."""
        with self._lock:
            if self._localizer is not None:
                try:
                    self._localizer.globalize()
                    self._kept = None
                    rospy.loginfo("particles spread over the whole map")
                except ValueError as error:
                    rospy.logwarn("global_localization: %s", error)

    def _relocalize(self, _request: TriggerRequest) -> TriggerResponse:
        """Start over at the places on the map where the newest scan fits, and answer with a list of them."""
        with self._lock:
            if self._localizer is None or self._newest_scan is None:
                return TriggerResponse(False, "there is no map or no scan yet")
            try:
                places = self._localizer.find(*self._newest_scan)
                self._scan_watch.warn_of_search(places.searched)
                if len(places.poses):
                    self._localizer.globalize()
            except ValueError as error:
                return TriggerResponse(False, str(error))
        if not len(places.poses):
            return TriggerResponse(False, "the newest scan fits nowhere on the map; the pose is left as it is")
        return TriggerResponse(True, describe_places(places))

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

    def _take_scan(self, message: LaserScanMessage) -> None:
        self._queue.offer(message, rospy.get_time())

    def is_ready(self, message: AnyScan) -> bool:
        """Return whether odometry is known at a scan's time, and where its lidar sits."""
        base, frame = self._parameters.base_frame_id, message.header.frame_id
        taken, is_known = self._timings.taken_at(frame, message.header.stamp.to_sec()), self.transforms.can_transform
        return is_known(self._parameters.odom_frame_id, base, taken) and is_known(base, frame)

    def process(self, message: AnyScan) -> None:
        """Run the filter on one scan whose transform is there, and publish what comes out."""
        if stands_in_the_world(self.transforms, self._parameters, message):
            return
        stamp = message.header.stamp
        self._scan_watch.saw(stamp.to_sec())
        with self._lock:
            if self._localizer is None:
                return
            values, began = self._parameters, time.perf_counter()
            try:
                scan, laser_pose = self._read(message)
                self._odom_pose = self.transforms.lookup(values.odom_frame_id, values.base_frame_id, scan.stamp)
                self._newest_scan = scan, laser_pose
                self._resume(scan.stamp)
                estimate = self._localizer.process(self._odom_pose, scan, laser_pose)
                self._scan_watch.warn_of_jumps(self._localizer.odometry.jumps, self._odom_pose)
                self._scan_watch.warn_of_search(self._localizer.searched)
            except (ValueError, TransformError) as error:
                rospy.logwarn_throttle(5.0, f"scan ignored: {error}")
                return
            map_from_odom, particles = self._localizer.map_from_odom, self._localizer.poses
            taken = stamp + rospy.Duration.from_sec(scan.stamp - stamp.to_sec())
            if map_from_odom is not None:
                self._map_to_odom.update(map_from_odom, max(stamp, taken))  # an earlier stamp would be too old
            if estimate is not None:
                self._update_seconds = time.perf_counter() - began
                self._covariance = estimate.covariance
                belief = self._belief_publisher.take(self._localizer)
                self._reliability = belief.reliability
        self._scan_watch.warn_of_dates(self._timings)
        if estimate is not None:
            self._publish(estimate, particles, taken)
            self._belief_publisher.publish(belief, values.global_frame_id, taken)
        if self._saved_pose.take_turn(taken.to_sec(), values.save_pose_rate):
            self._save_pose(self._saved_pose.save_soon)

    def _read(self, message: AnyScan) -> Tuple[LaserScan, Pose2D]:
        """Return a scan, corrected for the times of its beams, and the pose of its frame in the base frame."""
        if isinstance(message, CloudScan):
            return self._timings.corrected(message.scan, message.laser_pose), message.laser_pose
        taken = self._timings.taken_at(message.header.frame_id, message.header.stamp.to_sec())
        mounted = scan_in_base(message, self._parameters.base_frame_id, self.transforms, taken=taken)
        return self._timings.corrected(mounted.scan), mounted.laser_in_base

    def _resume(self, stamp: float) -> None:
        """Start, at the first scan, at the saved pose of a previous amcl, moved by odometry until the scan's stamp (s).
        """
        kept, self._kept = self._kept, None
        if kept is None:
            return
        assert self._localizer is not None and self._odom_pose is not None
        pose, sentence = kept.resume(self._odom_pose, stamp, self._fit)
        self._localizer.set_initial_pose(pose, self._covariance)
        rospy.loginfo("starting %s", sentence)

    def _publish(self, estimate: Estimate, particles: np.ndarray, stamp: rospy.Time) -> None:
        message = PoseWithCovarianceStamped(header=header(self._parameters.global_frame_id, stamp))
        message.pose.pose, covariance = pose_to_message(estimate.pose), np.zeros((6, 6))
        covariance[np.ix_((0, 1, 5), (0, 1, 5))] = estimate.covariance
        message.pose.covariance = covariance.ravel().tolist()
        self._pose_publisher.publish(message)
        self._cloud_publisher.publish(ParticleCloud(header(self._parameters.global_frame_id, stamp), particles))

    # --- what is kept and told ------------------------------------------------------------------------------------

    def _save_pose(self, save: Callable[[KeptPose, np.ndarray], None]) -> None:
        with self._lock:
            pose, odom_pose, newest, covariance = self.pose(), self._odom_pose, self._newest_scan, self._covariance
        if pose is not None and odom_pose is not None and newest is not None:
            save(KeptPose(pose, odom_pose, newest[0].stamp), covariance)

    def _report(self) -> diagnostics.Report:
        with self._lock:
            values, covariance = self._parameters, self._covariance
            details = {
                "particles": 0 if self._localizer is None else len(self._localizer.poses),
                "last update [ms]": f"{1e3 * self._update_seconds:.2f}",
                "map -> odom age [s]": f"{self._map_to_odom.age():.2f}",
                "reliability": "unknown" if self._reliability is None else f"{self._reliability:.3f}",
            }
        return deviation_report(values, covariance, details)

    def _report_scans(self) -> diagnostics.Report:
        with self._lock:
            match, has_map = self._match(), self._localizer is not None
        waiting = self._queue.oldest() is not None
        return self._scan_watch.report(rospy.get_time(), has_map, match, waiting, self._timings)

    def _match(self) -> Optional[float]:
        """Return `_fit` of the newest scan at the estimated pose, None where one is missing."""
        pose = self.pose()
        return None if pose is None else self._fit(pose)

    def _fit(self, pose: Pose2D) -> Optional[float]:
        """Return the share, 0 to 1, of the newest scan that lies on the map's walls at a pose; None without a scan."""
        if self._newest_scan is None:
            return None
        assert self._localizer is not None
        try:
            return self._localizer.fit(pose, *self._newest_scan)
        except ValueError:
            return None


def main() -> None:
    """Run the node on topics, or with --run-from-bag BAG [--global-localization] on a recorded bag."""
    options = check_arguments(rospy.myargv(sys.argv)[1:])
    node = AmclNode()
    if options.bag is not None:
        from mbf_relay.ros.amcl.bag import run_from_bag

        run_from_bag(node, options.bag, options.global_localization)
        return
    node.open()
    spare_what_stays()
    node.run()

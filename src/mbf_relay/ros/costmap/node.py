"""A costmap under ROS: fed from topics and tf, updated at its rate on a thread of its own, and published."""

from __future__ import annotations

import threading
from typing import Any, Dict, List, Mapping, Optional

import rospy
from geometry_msgs.msg import Polygon

from mbf_relay.costmap import factory
from mbf_relay.costmap.freshness import next_update
from mbf_relay.costmap.layer import missing_inputs, tracks_of
from mbf_relay.costmap.outline import check_padded
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common import parameters as ros_parameters
from mbf_relay.ros.common.diagnostics import ERROR, OK, WARN, RateMeter, Report
from mbf_relay.ros.common.lidar_timings import LidarTimings
from mbf_relay.ros.common.node import one_line
from mbf_relay.ros.common.outlines import outline_from_message
from mbf_relay.ros.common.stepper import Stepper
from mbf_relay.ros.common.throttled_warnings import ThrottledWarnings
from mbf_relay.ros.common.transforms import Transforms
from mbf_relay.ros.costmap.inputs import WARN_PERIOD, MapInput, SensorInput
from mbf_relay.ros.costmap.publisher import CostmapPublisher
from mbf_relay.ros.costmap.reconfigure import serve_costmap
from mbf_relay.ros.costmap.tracks import TracksPublisher


class CostmapNode:
    """One costmap of a node: `~NAME/costmap`, `~NAME/costmap_updates`, `~NAME/footprint`, and what it listens to.

    Args:
        name: "global_costmap" or "local_costmap": the group of its parameters and the namespace of its topics.
        config: The node's parameters.
        transforms: Where frames are looked up.
        timings: Those of another costmap with the same lidars, to share them; None for its own.

    Raises:
        ValueError: A parameter is wrong; the text names it, its value and what is allowed.
    """

    def __init__(
        self, name: str, config: Mapping[str, Any], transforms: Transforms,
        timings: Optional[LidarTimings] = None,
    ) -> None:
        group = config.get(name, {})
        self.costmap = factory.build_costmap(name, group, config)
        for unknown, hint in factory.unknown_names(group).items():
            rospy.logwarn(
                "parameter %s is not known here and is ignored%s", rospy.resolve_name(f"~{name}/{unknown}"), hint
            )
        ros_parameters.warn_of(self.costmap.notes, f"~{name}")
        for layer_name, reason in self.costmap.failed.items():
            rospy.logerr("%s: layer '%s' is left out: %s", name, layer_name, reason)
        for layer in self.costmap.layers:
            if layer.notice:
                rospy.loginfo("%s: layer '%s' %s", name, layer.name, layer.notice)
        self._name, self._transforms = name, transforms
        self._stepper = Stepper(self._step)
        self._updates = RateMeter()
        self._resting = False
        self._next_publication = 0.0
        self._last: Optional[float] = None
        self._pose_warnings, self._stale_warnings, self._map_warnings = (ThrottledWarnings() for _ in range(3))
        self._placed: Dict[str, str] = {}  # frame of each layer's map for which a transform was known
        self.timings = timings or LidarTimings(transforms, lambda: (self.costmap.robot_frame, self.costmap.frame))
        parameters = self.costmap.parameters
        self._publisher = CostmapPublisher(
            name, parameters.published_footprint_topic, parameters.always_send_full_costmap,
            lambda: self.costmap.snapshot() if self.costmap.updates else None,
        )
        self._tracks = TracksPublisher(name)
        self._maps: List[MapInput] = []
        # keeps an update from showing a new map where the last one lay; taken before the costmap's own lock
        self._placing = threading.Lock()
        self._sensors: Dict[str, SensorInput] = {}

    def start(self) -> None:
        """Subscribe, and start the thread that updates and publishes."""
        for layer in self.costmap.layers:
            if layer.map_source is not None:
                self._maps.append(
                    MapInput(layer.name, layer.map_source, self.costmap, self._stepper.wake, self._placing))
        for name, [(layer, source), *_] in self.costmap.inputs.items():
            patience = max(layer.sensor_patience, self.costmap.parameters.transform_tolerance)
            self._sensors[name] = SensorInput(
                name, layer.sources[source], self.costmap, self._transforms, patience, layer.max_age(source),
                self.timings)
        topic = rospy.resolve_name(f"~{self._name}/{self.costmap.parameters.footprint_topic}")
        if topic != self._publisher.footprint_topic:  # costmap_2d's default names both alike, with different types
            rospy.Subscriber(topic, Polygon, self._take_footprint, queue_size=1)
        serve_costmap(self.costmap, self._stepper.wake)
        self._stepper.start()

    def close(self) -> None:
        """End the thread and unsubscribe."""
        self._stepper.stop()
        for map_input in self._maps:
            map_input.close()
        for sensor in self._sensors.values():
            sensor.close()

    def missing_input(self) -> str:
        """Return what is still missing for the first complete update, empty where there was one."""
        missing: List[Optional[str]] = [missing_inputs(self.costmap.layers)]
        if self.costmap.updates == 0:
            missing.append(self.costmap.stale_reason(rospy.get_time()))
        return "; ".join(reason for reason in missing if reason)

    @property
    def hangs_in(self) -> str:
        """Where an update that takes too long is at present, empty while none does; see Stepper."""
        return self._stepper.hangs_in

    def rest(self) -> None:
        """Stop updates until `resume`; the costmap becomes stale."""
        self._resting = True

    def resume(self) -> None:
        """Update again, at once."""
        self._resting = False
        self._updates = RateMeter()  # the pause is no lag
        self._stepper.wake()

    def report(self) -> Report:
        """Return the costmap's part of the node's diagnostics."""
        now, place = rospy.get_time(), self.hangs_in
        if place:  # the update may hold the locks needed below
            return ERROR, f"hangs in {place}", {}
        snapshot = self.costmap.snapshot()
        asked = self.costmap.parameters.update_frequency
        values = {
            "update rate asked for [Hz]": f"{asked:g}",
            "update rate [Hz]": f"{self._updates.rate():.1f}",
            "size [cells]": f"{snapshot.grid.width} x {snapshot.grid.height}",
            "changes": snapshot.revision,
            **self.timings.values(),
        }
        for name, sensor in self._sensors.items():
            age = sensor.age(now)
            values[f"age of {name} [s]"] = "none came" if age is None else f"{age:.2f}"
        if self.costmap.failed:
            values["layers left out"] = ", ".join(self.costmap.failed)
        if self._resting:
            return OK, "resting until the next goal", values
        stale = self.costmap.stale_reason(now)
        if stale is None and self._updates.lags(asked):
            return (
                WARN,
                f"updated at {self._updates.rate():.1f} Hz, asked for {asked:g} Hz: the machine is too slow for it",
                values,
            )
        if stale is None and self.costmap.failed:
            return WARN, f"up to date without {', '.join(self.costmap.failed)}, of unknown type", values
        if stale is None:
            return OK, "up to date", values
        reasons = [sensor.trouble for sensor in self._sensors.values()]
        return ERROR, "; ".join([stale] + [reason for reason in reasons if reason]), values

    def _take_footprint(self, message: Polygon) -> None:
        try:
            asked, outline = self.costmap.parameters, outline_from_message(message)
            check_padded(outline, asked.footprint_padding, asked.resolution)
            self.costmap.set_footprint(outline)
        except ValueError as error:
            rospy.logerr_throttle(WARN_PERIOD, f"{self._name}: footprint refused: {one_line(error)}")

    def _step(self, now: float) -> float:
        """Update once; return the time (s) of the next update."""
        if self._last is not None and now < self._last:
            self._next_publication = 0.0  # time was set back
        self._last = now
        try:
            if not self._resting:
                self._update(now)
        except Exception as error:  # the thread must go on; a stale costmap stops the robot
            rospy.logerr_throttle(WARN_PERIOD, f"{self._name}: update failed: {type(error).__name__}: {error}")
        return next_update(now, self.costmap.parameters.update_frequency, self.costmap.updates)

    def _update(self, now: float) -> None:
        pose = self._robot_pose()
        if pose is None:
            return
        with self._placing:
            if not self._place_maps():
                return
            for sensor in self._sensors.values():
                sensor.feed(now)
            self.costmap.update(now, pose)
        stale = self.costmap.stale_reason(now)  # checked here, since a dead sensor sends no message to be refused
        if stale is None:
            self._stale_warnings.worked()
        else:
            self._stale_warnings.say(stale)
        self._updates.tick(now)
        self._publisher.publish_footprint(self.costmap.oriented_footprint(pose), self.costmap.frame, now)
        self._tracks.publish(tracks_of(self.costmap.layers) or (), self.costmap.frame)
        frequency = self.costmap.parameters.publish_frequency
        if frequency > 0.0 and now >= self._next_publication - 0.001:
            self._next_publication = now + 1.0 / frequency
            self._publisher.publish(self.costmap.snapshot())

    def _robot_pose(self) -> Optional[Pose2D]:
        costmap = self.costmap
        try:
            pose = self._transforms.lookup(
                costmap.frame, costmap.robot_frame, max_age=costmap.parameters.transform_tolerance,
                named=f"{self._name}/transform_tolerance")
            self._pose_warnings.worked()
            return pose
        except TransformError as error:
            self._updates = RateMeter()  # waiting is no lag
            costmap.note_failure(str(error))
            self._pose_warnings.say(f"{self._name} waits for the robot's pose: {error}")
            return None

    def _place_maps(self) -> bool:
        """Give the layers the present transforms from the costmap's frame to their maps'.

        Returns:
            Whether every enabled layer's map has a place; it keeps its last where the transform is lost.
        """
        frames = {source.layer: source.frame for source in self._maps if source.frame is not None}
        frames.update((layer.name, layer.map_frame) for layer in self.costmap.layers if layer.map_frame)
        active = [layer.name for layer in self.costmap.layers if layer.enabled]
        troubles, here = [], self.costmap.frame
        for layer, frame in frames.items():
            try:
                place = self._transforms.lookup(frame, here) if frame != here else IDENTITY
                self.costmap.set_map_from_costmap(place, layer)
                self._placed[layer] = frame
            except TransformError as error:
                if layer in active:
                    troubles.append(f"{self._name} cannot place the map of layer '{layer}': {error}")
        if not troubles:
            self._map_warnings.worked()
            return True
        trouble = "; ".join(troubles)
        self._map_warnings.say(trouble)
        if all(self._placed.get(name) == frames.get(name) for name in active):
            return True
        self.costmap.note_failure(trouble)
        return False


def make_costmap_nodes(config: Mapping[str, Any], transforms: Transforms) -> Dict[str, CostmapNode]:
    """Return a node's costmaps, "global" and "local".

    They share the lidars' timings, learnt from the robot's motion in the local costmap's frame, in which it does not
    jump.

    Raises:
        ValueError: As for CostmapNode.
    """
    local = CostmapNode("local_costmap", config, transforms)
    return {"global": CostmapNode("global_costmap", config, transforms, local.timings), "local": local}

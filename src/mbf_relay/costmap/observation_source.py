"""One observation source of an obstacle layer: its prepared observations, and whether they are recent enough."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, replace
from typing import Deque, Dict, List, Optional, Tuple

import numpy as np

from mbf_relay.costmap import layer_kernels
from mbf_relay.costmap.lone_hits import LoneHits
from mbf_relay.costmap.observation import Observation
from mbf_relay.costmap.usual_age import UsualAge
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.scan_monitor import LARGEST_GAP
from mbf_relay.senders import HOW_TO_GO_ON, Senders
from mbf_relay.timing import SET_BACK

RANGE = "Range"
"""The data_type of sonars and infrared rangers, sensor_msgs/Range."""
LEVEL = 0.02
"""Slope of a beam, rise over horizontal distance, up to which it counts as level."""
NOTHING = np.empty((0, 2))
"""No points."""
ROUNDING = 1e-6
"""Tolerance (m) of limits on heights: a lidar may be mounted exactly at a limit, and transforms are rounded."""


@dataclass(frozen=True)
class SourceParameters(ParameterSet):
    """Parameters of one sensor of an obstacle layer, by costmap_2d's names."""

    topic: str = parameter("", "topic of the sensor; empty for the source's name")
    sensor_frame: str = parameter("", "frame the rays start from; empty for the message's frame", is_frame=True)
    data_type: str = parameter(
        "PointCloud", "type of message; Range only in a range sensor layer, which sets it itself",
        choices=("LaserScan", "PointCloud", "PointCloud2", RANGE))
    observation_persistence: float = parameter(
        0.0, "how long an observation is kept; 0 for only the newest", unit="s", minimum=0.0)
    expected_update_rate: float = parameter(
        0.0, "longest time between two messages before the costmap is stale; 0 derives it from the scans' period (see "
        "source_timeout)", unit="s", minimum=0.0)
    min_obstacle_height: float = parameter(0.0, "points lower than this, in the costmap's frame, are ignored", unit="m")
    max_obstacle_height: float = parameter(
        2.0, "points higher than this, in the costmap's frame, are ignored", unit="m")
    inf_is_valid: bool = parameter(
        True, "beams without a return clear cells up to range_max; with costmap_2d's default, false, obstacles that "
        "have left an open space stay for ever")
    largest_gap: float = parameter(
        LARGEST_GAP, "widest angle ahead without any valid reading (NaN, or below range_min) at which a LaserScan is "
        "still used; 0 for a lidar whose invalid readings mean that nothing is there, which is assumed of scans with "
        "six gaps or more if no scan has had an inf", unit="rad", minimum=0.0, maximum=2.0 * math.pi)
    marking: bool = parameter(
        True, "add points as obstacles; a point seen by a single beam of a LaserScan only if one of the last two scans "
        "saw it too, or two of the last four if there is dust in the air")
    clearing: bool = parameter(False, "free the cells that rays pass")
    obstacle_range: float = parameter(
        2.5, "greatest distance from the sensor at which points are added as obstacles", unit="m", minimum=0.0)
    raytrace_range: float = parameter(
        3.0, "greatest distance from the sensor up to which rays free cells", unit="m", minimum=0.0)

    def check(self) -> None:
        if self.min_obstacle_height > self.max_obstacle_height:
            raise ValueError(
                f"parameter min_obstacle_height is {self.min_obstacle_height} m; it must not be above "
                f"max_obstacle_height, {self.max_obstacle_height} m")


@dataclass(frozen=True, eq=False)
class RayBundle:
    """An observation prepared for the kernels; all positions in metres, in the costmap's frame.

    Attributes:
        x, y: Position of the sensor.
        ends: Shape (N, 2): ends of the rays.
        marks: Shape (M, 2): those that become obstacles.
        low, high: Lower left and upper right corner of a box that holds all that rays and marks can change.
        reach: Largest length (m) of rays that clear: raytrace_range.
        stamp: Time (s) of the measurement.
        unseen: See Observation; shape (0, 2) for none. Obstacles between the sensor and these points are not cleared.
    """

    x: float
    y: float
    ends: np.ndarray
    marks: np.ndarray
    low: Tuple[float, float]
    high: Tuple[float, float]
    reach: float
    stamp: float
    unseen: np.ndarray


class Sensor:
    """The kept observations of one sensor.

    Attributes:
        trouble: Why the sensor's data must not be relied on, or None.
        kept: Its observations, newest first.
        last_update: Time (s) of its newest measurement.
        usual_age: How old its data usually get, see UsualAge.
        lone_hits: Its filter of single hits.
    """

    def __init__(self) -> None:
        self.trouble: Optional[str] = None
        self.kept: Deque[RayBundle] = deque()
        self.last_update = -math.inf
        self.usual_age = UsualAge()
        self.lone_hits = LoneHits()

    def add(self, rays: RayBundle, now: float, keep_time: float) -> None:
        """Keep an observation, and drop those older than `keep_time` (s); 0 keeps the newest alone."""
        measured = min(rays.stamp, now)
        if self.last_update > -math.inf:
            self.usual_age.renewed(now - self.last_update, measured - self.last_update)
        if measured < self.last_update - SET_BACK:
            self.kept.clear()
        self.last_update = measured
        self.kept.appendleft(rays)
        if keep_time == 0.0:
            while len(self.kept) > 1:
                self.kept.pop()
        else:
            while self.kept and now - self.kept[-1].stamp > keep_time:
                self.kept.pop()


class ObservationSource:
    """The data of one topic, from one sensor or from several, which are told apart by their frames.

    Attributes:
        parameters: The source's.
        trouble: Why the source must not be relied on, or None.
        unused: Why its last message was not used, or None.
    """

    def __init__(self, parameters: SourceParameters) -> None:
        self.parameters = parameters
        self.trouble: Optional[str] = None
        self.unused: Optional[str] = None
        self._sensors: Dict[str, Sensor] = {}
        self._senders = Senders()

    def add(self, observation: Observation, now: float, max_height: float) -> None:
        """Keep an observation of one of its sensors.

        Args:
            observation: In the costmap's frame.
            now: Present time (s).
            max_height: Height (m) above which the layer marks no obstacles.
        """
        frame = observation.frame
        rays = prepare(observation, self.parameters, max_height)
        self._senders.hear(frame, now, is_guest=not observation.rides)
        sensor = self._sensors.setdefault(frame, Sensor())
        sensor.trouble = self._overlooks(observation, max_height) if len(rays.marks) == 0 else None
        if sensor.trouble is None:
            if self.parameters.data_type == "LaserScan":
                rays = replace(rays, marks=sensor.lone_hits.without(rays.x, rays.y, rays.ends, rays.marks))
            sensor.add(rays, now, self.parameters.observation_persistence)
        self.trouble = self.unused = None

    def _overlooks(self, observation: Observation, max_height: float) -> Optional[str]:
        """Return why no hit of a level lidar can become an obstacle, None where hits can.

        One mounted below or above the limits on heights would show free space whatever is there.
        """
        low, high = self.parameters.min_obstacle_height, min(self.parameters.max_obstacle_height, max_height)
        origin, is_lidar = observation.origin, self.parameters.data_type == "LaserScan"
        if not (is_lidar and self.parameters.marking) or len(origin) < 3:
            return None
        if low - ROUNDING <= origin[2] <= high + ROUNDING:
            return None
        hits = np.isfinite(observation.points).all(axis=1)
        hits &= True if observation.hits is None else observation.hits
        offsets = observation.points[hits] - origin
        if len(offsets) == 0 or (np.abs(offsets[:, 2]) > LEVEL * np.hypot(offsets[:, 0], offsets[:, 1])).any():
            return None
        return (f"it looks level at {origin[2]:.2f} m, and what lies between {low:g} and {high:g} m becomes an "
                "obstacle (min_obstacle_height, max_obstacle_height): nothing of what it sees would; where others see "
                "in its place, marking: false says so")

    @property
    def sensors(self) -> Dict[str, Sensor]:
        """Its sensors by their frames; the source is stale when one of these falls silent."""
        return {frame: self._sensors[frame] for frame in self._senders.present}

    @property
    def kept(self) -> List[RayBundle]:
        """The observations kept, of all its sensors."""
        return [rays for frame in self._senders.heard for rays in self._sensors[frame].kept]

    def stale_reason(self, name: str, limit: float, now: float) -> Optional[str]:
        """Return why its data are unreliable, missing or too old; None where they are good.

        Args:
            name: The source's name.
            limit: Largest age (s) of a sensor's data; 0 for no limit.
            now: Time (s).
        """
        parameters = self.parameters
        is_lidar = parameters.data_type == "LaserScan"
        whose = f"{'lidar' if is_lidar else 'sensor'} source '{name}' on topic '{parameters.topic}'"
        sensors = self.sensors
        for trouble in (self.trouble, *(sensor.trouble for sensor in sensors.values())):
            if trouble is not None:
                return f"{whose} cannot be relied on: {trouble}"
        if limit == 0.0:
            return None
        if not sensors and self.unused is None:
            return f"no data has come from {whose}"
        if not sensors:
            return f"nothing from {whose} could be used: {self.unused}"
        for frame, sensor in sensors.items():
            longest = limit
            if is_lidar and parameters.expected_update_rate == 0.0:
                longest = sensor.usual_age.limit(limit)
            age = now - sensor.last_update
            if -SET_BACK <= age <= longest:
                continue
            which, told = whose, f"for {age:.2f} s; at most {longest:.2f} s is allowed"
            if age < 0.0:
                told = "since time was set back"
            if len(sensors) > 1:
                which, told = f"{whose}, the one of {len(sensors)} in frame '{frame}',", f"{told}; {HOW_TO_GO_ON}"
            if self.unused is None:
                return f"{which} sent nothing {told}"
            return f"{which} sent nothing that could be used {told}; {self.unused}"
        return None


def prepare(observation: Observation, source: SourceParameters, max_height: float) -> RayBundle:
    """Return an observation prepared for the kernels, limits on heights and ranges applied.

    Args:
        observation: In the costmap's frame.
        source: The source's parameters.
        max_height: Height (m) above which the layer marks no obstacles.
    """
    points = np.ascontiguousarray(observation.points, dtype=np.float64)
    hits = np.ones(len(points), np.bool_) if observation.hits is None else np.ascontiguousarray(observation.hits, bool)
    x, y, *height = map(float, observation.origin)
    reach = source.raytrace_range
    ends, marked, box = np.empty((len(points), 2)), np.empty((len(points), 2)), np.empty(4)
    number, marks = layer_kernels.make_ready(
        points, hits, x, y, height[0] if height else 0.0, source.min_obstacle_height - ROUNDING,
        source.max_obstacle_height + ROUNDING, max_height + ROUNDING, source.obstacle_range, ends, marked, box)
    left, bottom, right, top = box.tolist()
    low, high = (min(x - reach, left), min(y - reach, bottom)), (max(x + reach, right), max(y + reach, top))
    unseen = NOTHING if observation.unseen is None else np.ascontiguousarray(observation.unseen[:, :2])
    return RayBundle(x, y, ends[:number], marked[:marks], low, high, reach, observation.stamp, unseen)

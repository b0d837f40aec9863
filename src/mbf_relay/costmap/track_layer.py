"""The track layer: tracks moving obstacles in laser scans, for controllers, and can add costs around them."""

from __future__ import annotations

import dataclasses
import itertools
import math
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, Optional, Tuple

import numpy as np

from mbf_relay.costmap.cost_grid import EMPTY, INSCRIBED, Window
from mbf_relay.costmap.layer import Layer, LayerContext
from mbf_relay.costmap.observation import Observation
from mbf_relay.costmap.observation_source import SourceParameters
from mbf_relay.costmap.obstacle_layer import ObstacleLayerParameters
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.parameters import parameter
from mbf_relay.senders import Senders
from mbf_relay.tracking.parameters import TrackerParameters
from mbf_relay.tracking.track import Track
from mbf_relay.tracking.tracker import Tracker

_Lidar = Tuple[str, str]  # source and frame
REACH = 3.0
"""Standard deviations beyond which the cost of personal space is neglected."""


@dataclass(frozen=True)
class TrackLayerParameters(TrackerParameters):
    """Parameters of the track layer; each source has a group of its own, as in the obstacle layer."""

    enabled: bool = parameter(True, "track moving obstacles")
    observation_sources: str = parameter("", "names of the lidars, separated by spaces; each has a group of its name")
    mark_movers: bool = parameter(
        True, "mark moving obstacles in the costmap; false lets paths lead through where somebody is walking")
    personal_space: float = parameter(
        0.0, "standard deviation of the cost around a moving obstacle, from its edge outward; 0 for no such cost", "m",
        minimum=0.0)
    personal_space_cost: int = parameter(150, "cost at the edge of a moving obstacle", minimum=0, maximum=INSCRIBED - 1)
    personal_space_ahead: float = parameter(
        2.0, "the cost extends ahead by the obstacle's speed times this", "s", minimum=0.0)
    source_parameters: Mapping[str, SourceParameters] = parameter({}, "read from the sources' groups; not to be set")

    @classmethod
    def known(cls, values: Mapping[str, Any]) -> Dict[str, Any]:
        """Return the layer's own values, and as `source_parameters` those of its lidars' groups."""
        sources = ObstacleLayerParameters.known(values)["source_parameters"]
        scans = {name: source for name, source in sources.items() if source.data_type == "LaserScan"}
        return {**super().known(values), "source_parameters": scans}

    @classmethod
    def groups(cls, values: Mapping[str, Any]) -> List[str]:
        """Return the names of all sources, including those that are no lidars."""
        return ObstacleLayerParameters.groups(values)


def _looks_alike(one: TrackLayerParameters, other: TrackLayerParameters) -> bool:
    """Return whether two layers have the same sources and tracker parameters, and so find the same tracks."""
    names = TrackerParameters.types()
    return one.source_parameters == other.source_parameters and all(
        getattr(one, name) == getattr(other, name) for name in names)


class TrackLayer(Layer):
    """Tracks moving obstacles, with one tracker per lidar, also where lidars share a topic.

    The only costs it writes are those of personal space, with `personal_space` above 0.

    The costmap's frame should be one in which the robot's pose does not jump, such as odom: in map, a correction of the
    pose makes everything seem to move.
    """

    Parameters = TrackLayerParameters
    parameters: TrackLayerParameters

    def __init__(self, name: str, parameters: TrackLayerParameters) -> None:
        super().__init__(name, parameters)
        self._lidars: Dict[str, Senders] = {source: Senders() for source in parameters.source_parameters}
        self._trackers: Dict[_Lidar, Tracker] = {}
        self._numbers = itertools.count(1)  # of tracks, unique over all trackers
        self._other: Optional[TrackLayer] = None  # see `share`
        self._frame = IDENTITY
        self._shown: Dict[_Lidar, Tuple[Tracker, Pose2D]] = {}  # tracker of each lidar's last scan, and its frame
        self._written = EMPTY
        self._around: Tuple[Track, ...] = ()

    def reconfigure(self, parameters: TrackLayerParameters) -> None:
        super().reconfigure(parameters)
        self._other = None
        if not parameters.enabled:
            self._trackers.clear()  # old tracks must not come back when it is enabled again
            self._shown.clear()
        for tracker in self._trackers.values():
            tracker.parameters = parameters

    @property
    def sources(self) -> Mapping[str, SourceParameters]:
        return self.parameters.source_parameters

    @property
    def tracks(self) -> Tuple[Track, ...]:
        return tuple(
            track if frame is IDENTITY else track.seen_from(frame)
            for (source, lidar), (tracker, frame) in self._shown.items() if lidar in self._lidars[source].heard
            for track in tracker.tracks)

    def share(self, other: Layer, frame: Pose2D) -> None:
        if isinstance(other, TrackLayer) and _looks_alike(self.parameters, other.parameters):
            self._other, self._frame = other, frame

    def observe(self, source: str, observation: Observation, now: float) -> Observation:
        if not self.enabled:
            return observation
        ends = np.asarray(observation.points, dtype=float)[:, :2]
        hits = np.ones(len(ends), dtype=bool) if observation.hits is None else observation.hits
        finite = np.isfinite(ends[:, 0]) & np.isfinite(ends[:, 1])
        x, y = observation.origin[:2]
        self._lidars[source].hear(observation.frame, now, is_guest=not observation.rides)
        lidar = source, observation.frame
        tracker = self._other.tracker_at(lidar, observation.stamp) if self._other is not None else None
        if tracker is not None:
            self._shown[lidar] = tracker, self._frame
        else:
            if lidar not in self._trackers:
                self._trackers[lidar] = Tracker(self.parameters, self._numbers)
            tracker = self._trackers[lidar]
            tracker.update(
                float(x), float(y), ends[finite], hits[finite], observation.stamp, observation.heading)
            self._shown[lidar] = tracker, IDENTITY
        if self.parameters.mark_movers:
            return observation
        stands = hits.copy()
        stands[finite] &= ~tracker.moving
        return dataclasses.replace(observation, hits=stands)

    def tracker_at(self, lidar: _Lidar, stamp: float) -> Optional[Tracker]:
        """Return this layer's own tracker of a lidar if its last scan was that of `stamp` (s), else None."""
        tracker = self._trackers.get(lidar)
        return tracker if tracker is not None and tracker.stamp == stamp else None

    def update_bounds(self, context: LayerContext, window: Window) -> Window:
        before, self._written = self._written, EMPTY
        self._around = ()
        if self.parameters.personal_space > 0.0:
            self._around = tuple(track.at(context.now) for track in self.tracks)
            for track in self._around:
                self._written = self._written.union(self._window_of(track))
            self._written = self._written.within(self.grid)
        return window.union(before).union(self._written)

    def _window_of(self, track: Track) -> Window:
        return Window.around(self.grid, track.x, track.y, track.radius + REACH * self._deviation_ahead(track))

    def _deviation_ahead(self, track: Track) -> float:
        return self.parameters.personal_space + self.parameters.personal_space_ahead * track.speed / REACH

    def update_costs(self, costs: np.ndarray, window: Window) -> None:
        for track in self._around:
            part = self._window_of(track).within(self.grid)
            part = Window(
                max(part.x0, window.x0), max(part.y0, window.y0), min(part.x1, window.x1), min(part.y1, window.y1)
            )
            if part.is_empty:
                continue
            rows, columns = np.mgrid[part.y0:part.y1, part.x0:part.x1]
            across = self.grid.origin_x + (columns + 0.5) * self.grid.resolution - track.x
            up = self.grid.origin_y + (rows + 0.5) * self.grid.resolution - track.y
            cost = self.parameters.personal_space_cost * self._share(track, across, up)
            below = costs[part.slices]
            costs[part.slices] = np.where(below < INSCRIBED, np.maximum(below, cost.astype(np.uint8)), below)

    def _share(self, track: Track, across: np.ndarray, up: np.ndarray) -> np.ndarray:
        """Return the share, 0 to 1, of personal_space_cost at distances (m) in x and y from a track's centre.

        It is a Gaussian of the distance to the obstacle's edge, wider ahead of it.
        """
        heading = math.atan2(track.vy, track.vx)
        ahead = math.cos(heading) * across + math.sin(heading) * up
        aside = math.cos(heading) * up - math.sin(heading) * across
        scale = np.where(ahead > 0.0, self._deviation_ahead(track), self.parameters.personal_space)
        distance = np.hypot(across, up)
        outside = np.maximum(0.0, distance - track.radius) / np.maximum(distance, 1e-9)
        along, across = outside * ahead / scale, outside * aside / self.parameters.personal_space
        share: np.ndarray = np.exp(-0.5 * (along ** 2 + across ** 2))
        return share

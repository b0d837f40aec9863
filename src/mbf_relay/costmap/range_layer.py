"""What sonars and infrared rangers measure, as probabilities of cells (range_sensor_layer's RangeSensorLayer).

A ranger measures the distance to the nearest object in its cone, but not the direction. So a reading raises the
probability of cells along its arc, most in the middle of the cone, and lowers that of cells before the arc. Cells are
lethal above mark_threshold and free below clear_threshold. Sensor model and constants are those of the C++ layer.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any, Deque, Dict, List, Mapping, Optional, Tuple

import numpy as np

from mbf_relay.costmap import layer_kernels
from mbf_relay.costmap.cost_grid import FREE_SPACE, LETHAL, NO_INFORMATION, Window
from mbf_relay.costmap.layer import CellLayer, LayerContext, changed_window, shifted
from mbf_relay.costmap.observation import Observation
from mbf_relay.costmap.observation_source import RANGE, SourceParameters
from mbf_relay.grid import Grid
from mbf_relay.parameters import ParameterSet, parameter, without_effect

UNDECIDED = 0.5
"""Probability of a cell without readings."""
SUREST = 0.95
"""Probabilities are limited to 1 - SUREST and SUREST, so that later readings can change them."""
MOST_READINGS = 100
"""Readings kept until the next update: a disabled layer has none for a long time."""
FARTHEST = 10.0
"""Metres above which a reading is not taken for an obstacle; cells beyond are not freed either."""
FADES = 2.0
"""Slope (1/m) with which a reading's weight falls around the distance `phi`."""


@dataclass(frozen=True)
class RangeSensorLayerParameters(ParameterSet):
    """Parameters of the range sensor layer, by range_sensor_layer's names."""

    enabled: bool = parameter(True, "use this layer")
    ns: str = parameter("", "namespace put before each topic; empty for none")
    topics: Tuple[str, ...] = parameter(("/sonar",), "topics of sensor_msgs/Range; several sensors may share one")
    input_sensor_type: str = without_effect(
        "ALL", "a message whose min_range equals its max_range is from a fixed-distance sensor",
        choices=("VARIABLE", "FIXED", "ALL"))
    no_readings_timeout: float = parameter(
        0.0, "longest time between two readings of a topic before the costmap is stale; 0 for no limit", "s",
        minimum=0.0)
    clear_on_max_reading: bool = parameter(False, "a reading of max_range or more frees the whole cone")
    clear_threshold: float = parameter(
        0.2, "probability of an obstacle below which a cell is free", minimum=0.0, maximum=1.0)
    mark_threshold: float = parameter(
        0.8, "probability of an obstacle above which a cell is lethal", minimum=0.0, maximum=1.0)
    phi: float = parameter(1.2, "distance at which a reading has half its weight", "m", minimum=0.0)
    inflate_cone: float = parameter(
        1.0, "share of the sensor's cone, in width, that is updated", minimum=0.0, maximum=1.0)

    def check(self) -> None:
        """Raise ValueError where a cell could be free and an obstacle at once."""
        if self.mark_threshold < self.clear_threshold:
            raise ValueError(
                f"parameter mark_threshold is {self.mark_threshold}; it must not be below clear_threshold, "
                f"{self.clear_threshold}")

    def full_topics(self) -> List[str]:
        """Return the topics with their namespace before them."""
        return [f"{self.ns.rstrip('/')}/{topic.lstrip('/')}" if self.ns else topic for topic in self.topics]

    def read_as(self) -> List[str]:
        """Return notes as ParameterSet.read_as does, with one where there are no topics."""
        return [*super().read_as(), *([] if self.topics else ["parameter topics is empty: the layer sees nothing"])]


class RangeSensorLayer(CellLayer):
    """Keeps for each cell the probability of an obstacle, from readings of rangers; see the module.

    A reading is an observation of three rays: the cone's right edge, its middle and its left edge.
    """

    Parameters = RangeSensorLayerParameters
    parameters: RangeSensorLayerParameters
    default_cost = NO_INFORMATION

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        if not parameters.clear_on_max_reading:
            self.notice = "takes a reading of max_range for no obstacle; the C++ layer adds one"
        self._probability = np.zeros((0, 0), dtype=np.float32)
        self._readings: Deque[Observation] = deque(maxlen=MOST_READINGS)
        self._heard: Dict[str, float] = {}
        self._refused: Dict[str, str] = {}
        self._sources = {
            topic: SourceParameters(topic=topic, data_type=RANGE, inf_is_valid=parameters.clear_on_max_reading)
            for topic in parameters.full_topics()}

    @property
    def sources(self) -> Mapping[str, SourceParameters]:
        return self._sources

    def observe(self, source: str, observation: Observation, now: float) -> None:
        self._heard[source] = observation.stamp
        self._refused.pop(source, None)
        if len(observation.points) == 3:  # else the reading is no measurement
            self._readings.append(observation)

    def refuse(self, source: str, reason: str, is_blind: bool) -> None:
        self._refused[source] = reason

    def stale_reason(self, now: float) -> Optional[str]:
        limit = self.parameters.no_readings_timeout
        for source in self._sources if limit > 0.0 else ():
            heard = self._heard.get(source)
            if heard is None or abs(now - heard) > limit:  # or time was set back since
                since = "no reading has come" if heard is None else f"no reading for {abs(now - heard):.2f} s"
                why = f"; {self._refused[source]}" if source in self._refused else ""
                return f"ranger on topic '{source}': {since}; at most {limit:.2f} s allowed (no_readings_timeout){why}"
        return None

    def resize(self, grid: Grid) -> None:
        super().resize(grid)
        self._probability = np.full(grid.shape, UNDECIDED, dtype=np.float32)

    def shift(self, grid: Grid, columns: int, rows: int) -> None:
        super().shift(grid, columns, rows)
        self._probability = shifted(self._probability, columns, rows, UNDECIDED)

    def update_bounds(self, context: LayerContext, window: Window) -> Window:
        while self._readings:
            self._take(self._readings.popleft())
        return window.union(self.take_pending())

    def update_costs(self, costs: np.ndarray, window: Window) -> None:
        layer_kernels.merge_maximum(costs, self.costs, *window)

    def clear(self, window: Window, inside: bool) -> None:
        window = window.within(self.grid)
        kept = self._probability[window.slices].copy()
        if inside:
            self._probability[window.slices] = UNDECIDED
        else:
            self._probability.fill(UNDECIDED)
            self._probability[window.slices] = kept
        self._show(Window.of(self.grid))

    def _take(self, reading: Observation) -> None:
        """Update the probabilities of the cells in a reading's cone (Bayes' rule)."""
        origin, hit = np.array(reading.origin[:2]), reading.hits is None or bool(reading.hits[1])
        edges = reading.points[:, :2] - origin
        right, ahead, left = edges
        distance, heading = float(np.hypot(*ahead)), math.atan2(ahead[1], ahead[0])
        if distance == 0.0 or (hit and distance > FARTHEST):
            return
        distance, edges = min(distance, FARTHEST), edges * min(1.0, FARTHEST / distance)
        half = 0.5 * float(abs(math.atan2(left[1], left[0]) - math.atan2(right[1], right[0])))
        half = min(half, math.pi - half)
        band = self.grid.resolution * max(distance, 1.0)  # m to either side of the arc; a cell at least
        bulge = band + distance * (1.0 - math.cos(0.5 * half))  # m that the arc may lie outside the box of the ends
        corners = np.vstack((origin, origin + edges))
        window = Window.over(self.grid, corners.min(axis=0) - bulge, corners.max(axis=0) + bulge).within(self.grid)
        if window.is_empty:
            return
        rows, columns = np.ogrid[window.slices]
        dx = self.grid.origin_x + (columns + 0.5) * self.grid.resolution - origin[0]
        dy = self.grid.origin_y + (rows + 0.5) * self.grid.resolution - origin[1]
        away, bearing = np.hypot(dx, dy), np.arctan2(dy, dx) - heading
        aside = np.abs(np.remainder(bearing + math.pi, 2.0 * math.pi) - math.pi)
        looked_at = (aside <= self.parameters.inflate_cone * half) & (away <= distance + band)
        if hit:
            occupied = likelihood(away, aside, distance, half, band, self.parameters.phi)
        else:
            occupied = np.where(away <= distance, 1.0 - SUREST, UNDECIDED)
        before = self._probability[window.slices]
        joint = occupied * before
        after = np.clip(joint / (joint + (1.0 - occupied) * (1.0 - before)), 1.0 - SUREST, SUREST)
        self._probability[window.slices] = np.where(looked_at, after, before)
        self._show(window)

    def _show(self, window: Window) -> None:
        """Set the costs in a window from its probabilities."""
        if window.is_empty:
            return
        probability, before = self._probability[window.slices], self.costs[window.slices].copy()
        costs = np.full(probability.shape, NO_INFORMATION, dtype=np.uint8)
        costs[probability < self.parameters.clear_threshold] = FREE_SPACE
        costs[probability > self.parameters.mark_threshold] = LETHAL
        self.costs[window.slices] = costs
        self.touch(changed_window(before, self.costs, window))


def likelihood(
    away: np.ndarray, aside: np.ndarray, distance: float, half: float, band: float, phi: float
) -> np.ndarray:
    """Return the probability that cells are occupied, given a reading: 0.5 where it tells nothing; shape of `away`.

    Args:
        away: Distances (m) of the cells from the sensor.
        aside: Angles (rad) of the cells from the middle of the cone, 0 or above.
        distance: The reading (m).
        half: Half the cone's angle (rad).
        band: Half the thickness (m) of the arc that may be occupied.
        phi: Distance (m) at which a reading has half its weight.
    """
    fading = 0.5 * (1.0 - np.tanh(FADES * (away - phi)))
    weight = fading * np.clip(1.0 - (aside / max(half, 1e-9)) ** 2, 0.0, None)
    before, off = distance - 2.0 * band, (distance - away) / band
    rising = 0.5 * np.clip((away - before) / band, 0.0, 1.0) ** 2
    on_arc = np.abs(off) <= 1.0
    value = np.where(on_arc, 1.0 - 0.5 * off ** 2, rising)
    return np.where(away > distance + band, UNDECIDED, UNDECIDED + weight * (value - UNDECIDED))

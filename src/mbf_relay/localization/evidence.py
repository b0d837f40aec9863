"""Evidence of one scan for a pose, on a map of which parts are missing or outdated.

Maps are never complete: walls were built, racks moved, rooms never mapped. Each beam is of one class (compare als_ros):

    hit       it ends on a mapped obstacle
    unmapped  it ends where no obstacle is mapped
    through   it ends where no obstacle is mapped, and passes through a mapped one on its way

A beam without a return counts as `through` where a mapped obstacle is in its way, and is ignored otherwise. In open
places such beams are the only difference between a wrong pose and the right one. They have a small weight, because
glass, black surfaces and walls that were removed give no return either.

The probability of an unmapped beam is the share of such beams at the held pose, learnt over tens of metres: where a
third of the walls is not mapped, ten more explained beams prove little. Walls seldom vanish, so `through` has a fixed
and lower probability.

At a right pose, too, some beams pass through occupied cells: they graze edges, legs of tables, large cells and walls
that are bent on the map. Their share is learnt on the drive from the beams that hit, which cannot have been blocked.
Only the excess over it counts against a pose.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mbf_relay.localization.beams import Beams
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.laser_kernels import judge_scan, trace_endpoints
from mbf_relay.localization.reliability import LEAST
from mbf_relay.localization.scan_likelihood import some_of, thin_out

BEAMS = 60
"""Beams of a scan that are used, about."""
INDEPENDENT_BEAMS = 20.0
"""Number of independent beams that a scan's log-likelihood is scaled to: its beams hit the same few walls with the same
errors."""
THROUGH = 0.1
"""Share of the unmapped beams that pass through mapped obstacles at a right pose: opened doors, grazed edges."""
WALL_MARGIN = 0.3
"""Length (m) at both ends of a beam that is not checked for obstacles, because pose and map are not more exact."""
USUAL_UNMAPPED = 0.2
"""Share of unmapped beams assumed at a start."""
LEARNT_OVER = 30.0
"""Distance (m) over which the shares of unmapped and of grazing beams are learnt."""
BOUNDS = (0.05, 0.6)
"""Limits of the learnt share of unmapped beams: no map is perfect, and with a larger share a scan would prove nothing.
"""
MOST_GRAZE = 0.15
"""Largest share of the hitting beams that is taken for grazing at a right pose; a larger one means a wrong pose."""
OF_OTHERS = 0.5
"""Grazing rate of the unmapped beams relative to that of the hitting ones: 0.2 to 0.9 by drive."""


class Seen(NamedTuple):
    """The parts of a scan that evidence is computed from.

    Attributes:
        ends: Ends (m) of the beams with a return, thinned out, shape (B, 2), in the base's frame.
        passed: Points (m) at maximum range along the silent beams, shape (S, 2), in the base's frame.
        silence: Share of silent beams among all, 0 to 1.
        laser: Position (m) of the sensor in the base's frame, shape (2,).
    """

    ends: np.ndarray
    passed: np.ndarray
    silence: float
    laser: np.ndarray

    @staticmethod
    def of(beams: Beams) -> Seen:
        """Return the parts for all of a scan's beams."""
        ends, passed = thin_out(beams.endpoints, among=beams.ranges < beams.range_max), beams.passed
        return Seen(
            ends, some_of(passed, BEAMS), len(passed) / max(1, len(beams.ranges)),
            np.array([beams.laser_pose.x, beams.laser_pose.y]),
        )


class Judgement(NamedTuple):
    """Evidence of a scan for K poses; each array has shape (K,).

    Attributes:
        log_likelihoods: Of the scan, scaled to INDEPENDENT_BEAMS.
        hits: Share of the beams that end on a mapped obstacle, 0 to 1.
        through: Share of all beams, silent ones included, that pass through a mapped obstacle, less the share that
            grazes one at a right pose; 0 or more.
        grazed: Share of the beams that end on a mapped obstacle and pass through another on their way.
    """

    log_likelihoods: np.ndarray
    hits: np.ndarray
    through: np.ndarray
    grazed: np.ndarray


class Evidence:
    """Computes the evidence of scans for poses, and learns how incomplete the map is.

    Attributes:
        unmapped: Share of the beams that end where no obstacle is mapped, learnt on this drive.
        grazing: Share of the unmapped beams that graze a mapped obstacle at a right pose, learnt on this drive.
    """

    def __init__(self, field: DistanceField, sigma: float) -> None:
        """Begin on a map; `sigma` is the standard deviation (m) of a hit, of which at least a cell is used."""
        self._field = field
        sigma = max(sigma, field.resolution)
        self._hits = np.exp(-0.5 * np.square(field.face_distances / sigma)).astype(np.float32)
        self.unmapped = USUAL_UNMAPPED
        self._grazed = self._hit = 0.0

    def go_on_from(self, before: Evidence) -> None:
        """Take over the shares that another instance has learnt."""
        self.unmapped, self._grazed, self._hit = before.unmapped, before._grazed, before._hit

    @property
    def grazing(self) -> float:
        """See the class; 0 before the first scan."""
        return OF_OTHERS * min(MOST_GRAZE, self._grazed / self._hit) if self._hit > 0.0 else 0.0

    def judge(self, poses: np.ndarray, seen: Seen) -> Judgement:
        """Return the evidence of a scan for poses.

        Args:
            poses: Shape (K, 3), in the map's frame; the first is the held one. If more beams are unmapped there than
                was learnt, that share is used for all poses.
            seen: Parts of the scan; with at least one end.
        """
        endpoints = some_of(seen.ends, BEAMS)
        field, judged = self._field, np.empty((5, len(poses)))
        judge_scan(
            np.ascontiguousarray(poses), endpoints, np.ascontiguousarray(seen.passed), seen.laser, field.codes,
            self._hits, field.cell_distances, field.frame, WALL_MARGIN, self.unmapped, BOUNDS[1], THROUGH, judged,
        )
        logs, hit, through, grazed, silent_through = judged
        silent = silent_through * (seen.silence * INDEPENDENT_BEAMS * math.log(BOUNDS[1]))
        through = np.maximum(0.0, through - self.grazing * (1.0 - hit))
        silent_through = np.maximum(0.0, silent_through - self.grazing)
        return Judgement(
            logs * min(INDEPENDENT_BEAMS, len(endpoints)) + silent, hit,
            (1.0 - seen.silence) * through + seen.silence * silent_through, grazed,
        )

    def silent_through(self, poses: np.ndarray, seen: Seen) -> np.ndarray:
        """Return at each pose, (K, 3) in, (K,) out, the share of the silent beams that pass through mapped obstacles.

        The share that grazes obstacles at a right pose is subtracted.
        """
        if not len(seen.passed):
            return np.zeros(len(poses))
        share: np.ndarray = self._trace(poses, np.ascontiguousarray(seen.passed), seen.laser).mean(axis=1)
        return np.maximum(0.0, share - self.grazing)

    def learn(self, hits: float, way: float) -> None:
        """Update the share of unmapped beams by the share of hits at the held pose, `way` (m) after the last scan."""
        share = 1.0 - math.exp(-way / LEARNT_OVER)
        self.unmapped = min(max(self.unmapped + share * (1.0 - hits - self.unmapped), BOUNDS[0]), BOUNDS[1])

    def learn_grazing(self, judged: Judgement, way: float) -> None:
        """Update the share of grazing beams by a judgement whose first pose is the held one, and reliable."""
        way = max(way, LEAST)
        kept = math.exp(-way / LEARNT_OVER)
        self._grazed = kept * self._grazed + way * float(judged.grazed[0])
        self._hit = kept * self._hit + way * float(judged.hits[0])

    def _trace(self, poses: np.ndarray, endpoints: np.ndarray, laser: np.ndarray) -> np.ndarray:
        passed = np.empty((len(poses), len(endpoints)), dtype=np.uint8)
        field = self._field
        trace_endpoints(poses, endpoints, laser, field.codes, field.cell_distances, field.frame, WALL_MARGIN, passed)
        return passed

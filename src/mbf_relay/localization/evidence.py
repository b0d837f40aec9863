"""Evidence for a pose: what one scan says for it, at the price that what is not on the map has on this drive.

Maps are never whole: walls were built, racks moved, blocks never seen. A beam is one of three kinds (compare als_ros):

    hit       it ends on something the map has
    unmapped  it ends where the map has nothing
    through   it ends where the map has nothing, and passed through something the map has on its way

A beam of which nothing came back is of the third kind where it would have met something the map has, and else says
nothing: at a wrong place of an open map it is all there is to tell it from the right one. Panes, black cloth and walls
that were taken away are silent too, so that it is no more than a hint.

The share of the unmapped at the pose held is the price of such a beam; it is learnt over tens of metres. On a map that
lacks a third of its walls, a place that explains ten beams more is no proof. A wall seldom vanishes, so that passing
through one costs more, and always the same.

Not all that a beam passes through is a wall in its way: it grazes edges, above all of large cells and of walls that are
bent on the map, and legs of tables. How many do at a right place is told by those that hit, for these must have got
there; it, too, is learnt on the drive, and only what is more than those would be speaks against a pose.
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
"""Beams of a scan that are looked at."""
INDEPENDENT_BEAMS = 20.0
"""A scan says no more than so many independent beams would: its beams hit the same few walls, by the same error."""
THROUGH = 0.1
"""Share of the unmapped that pass through walls where the pose is right: doors that opened, edges grazed."""
WALL_MARGIN = 0.3
USUAL_UNMAPPED = 0.2
LEARNT_OVER = 30.0
"""Way (m) over which the price of the unmapped is learnt, and how many beams graze something."""
BOUNDS = (0.05, 0.6)
"""Between which it lies: no map is perfect, and one that lacks more tells nothing."""
MOST_GRAZE = 0.15
"""Share of the beams that hit that may have grazed something at a right place: more do so where the pose is wrong."""
OF_OTHERS = 0.5
"""How many times as often those graze that end on nothing: a fifth to nine tenths, by drive."""


class Seen(NamedTuple):
    """What a scan has for evidence.

    Attributes:
        ends: Where beams ended on something, thinned out, shape (B, 2), in the base's frame.
        passed: Where those got to of which nothing came back, shape (S, 2), in the base's frame.
        silence: Share of the latter among all beams, 0 to 1.
        laser: Position of the sensor in the base's frame, shape (2,).
    """

    ends: np.ndarray
    passed: np.ndarray
    silence: float
    laser: np.ndarray

    @staticmethod
    def of(beams: Beams) -> Seen:
        """Return what a scan's beams, all of them, have."""
        ends, passed = thin_out(beams.endpoints, among=beams.ranges < beams.range_max), beams.passed
        return Seen(
            ends, some_of(passed, BEAMS), len(passed) / max(1, len(beams.ranges)),
            np.array([beams.laser_pose.x, beams.laser_pose.y]),
        )


class Judgement(NamedTuple):
    """What a scan says of poses, each of shape (K,).

    Attributes:
        log_likelihoods: Of the scan, tempered.
        hits: Share of the beams that end on something the map has.
        through: Share of the beams, silent ones among them, that passed through something the map has, beyond those
            that graze something at a right place, too.
        grazed: Share of the beams that end on something the map has and passed through something on their way.
    """

    log_likelihoods: np.ndarray
    hits: np.ndarray
    through: np.ndarray
    grazed: np.ndarray


class Evidence:
    """Judges poses by scans, and learns what the map lacks.

    Attributes:
        unmapped: Share of the beams that end where the map has nothing, on this drive.
        grazing: Share of the beams that pass through something and end on nothing the map has, of all that end on
            nothing, where the pose is right, on this drive.
    """

    def __init__(self, field: DistanceField, sigma: float) -> None:
        """Judge on a map; `sigma` is the deviation of a hit (m)."""
        self._field = field
        sigma = max(sigma, field.resolution)
        self._hits = np.exp(-0.5 * np.square(field.face_distances / sigma)).astype(np.float32)
        self.unmapped = USUAL_UNMAPPED
        self._grazed = self._hit = 0.0

    def go_on_from(self, before: Evidence) -> None:
        """Take over what was learnt on the drive."""
        self.unmapped, self._grazed, self._hit = before.unmapped, before._grazed, before._hit

    @property
    def grazing(self) -> float:
        """See the class; none is known of before the first scan."""
        return OF_OTHERS * min(MOST_GRAZE, self._grazed / self._hit) if self._hit > 0.0 else 0.0

    def judge(self, poses: np.ndarray, seen: Seen) -> Judgement:
        """Return what a scan says of poses.

        Args:
            poses: Shape (K, 3), in the map's frame; the first is the one held. Where little around it is mapped, little
                is proven by what is mapped elsewhere.
            seen: Of the scan; at least one beam ended on something.
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
        """Return at each pose, (K, 3) in, (K,) out, the share of the silent beams that pass through what the map has.

        Less those that graze something at a right place, too.
        """
        if not len(seen.passed):
            return np.zeros(len(poses))
        share: np.ndarray = self._trace(poses, np.ascontiguousarray(seen.passed), seen.laser).mean(axis=1)
        return np.maximum(0.0, share - self.grazing)

    def learn(self, hits: float, way: float) -> None:
        """Take the share of hits at the pose held, of a scan taken `way` (m) after the last."""
        share = 1.0 - math.exp(-way / LEARNT_OVER)
        self.unmapped = min(max(self.unmapped + share * (1.0 - hits - self.unmapped), BOUNDS[0]), BOUNDS[1])

    def learn_grazing(self, judged: Judgement, way: float) -> None:
        """Take what was said of poses of which the first is held and believed, likewise."""
        way = max(way, LEAST)
        kept = math.exp(-way / LEARNT_OVER)
        self._grazed = kept * self._grazed + way * float(judged.grazed[0])
        self._hit = kept * self._hit + way * float(judged.hits[0])

    def _trace(self, poses: np.ndarray, endpoints: np.ndarray, laser: np.ndarray) -> np.ndarray:
        passed = np.empty((len(poses), len(endpoints)), dtype=np.uint8)
        field = self._field
        trace_endpoints(poses, endpoints, laser, field.codes, field.cell_distances, field.frame, WALL_MARGIN, passed)
        return passed

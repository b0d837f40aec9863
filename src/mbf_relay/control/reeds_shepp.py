"""Reeds-Shepp curves: ways of a car between two poses, of arcs and straights, forwards and backwards.

Source: Reeds and Shepp, "Optimal paths for a car that goes both forwards and backwards" (1990), section 8, whose
equation numbers stand at the formulas. Among them is the shortest of all ways without obstacles.
"""

from __future__ import annotations

import math
from typing import Callable, Iterator, List, NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D, normalize_angle

LEFT, STRAIGHT, RIGHT = 1, 0, -1
SHORT = 1e-6  # radii: shorter parts are dropped

Word = List[Tuple[int, float]]
"""Segments: (LEFT, STRAIGHT or RIGHT, length in turning radii, below 0 for backwards)."""


class Curve(NamedTuple):
    """One way of arcs and straights.

    Attributes:
        word: Its segments.
        radius: Turning radius (m).
    """

    word: Word
    radius: float

    @property
    def length(self) -> float:
        """Metres driven."""
        return self.radius * sum(abs(length) for _, length in self.word)

    @property
    def cusps(self) -> int:
        """Number of changes between forwards and backwards."""
        signs = [length > 0.0 for _, length in self.word]
        return sum(one != other for one, other in zip(signs, signs[1:]))

    def forwards(self) -> Optional[Curve]:
        """Return it with each backward arc replaced by the rest of its circle; None if a straight leads backwards."""
        word = [(turn, length % (2.0 * math.pi) if turn else length) for turn, length in self.word]
        return Curve(word, self.radius) if all(length > 0.0 for _, length in word) else None

    def poses(self, start: Pose2D, step: float) -> np.ndarray:
        """Return poses from `start` on, at most `step` (m) apart, with the end of each segment; shape (S, 3)."""
        parts = [np.array([start], dtype=float)]
        for turn, length in self.word:
            x, y, theta = parts[-1][-1]
            driven = np.linspace(0.0, length, max(1, math.ceil(abs(length) * self.radius / step)) + 1)[1:]
            headings = theta + turn * driven
            if turn == STRAIGHT:
                ends = np.column_stack((x + driven * self.radius * math.cos(theta),
                                        y + driven * self.radius * math.sin(theta)))
            else:
                ends = np.column_stack((x + turn * self.radius * (np.sin(headings) - math.sin(theta)),
                                        y - turn * self.radius * (np.cos(headings) - math.cos(theta))))
            parts.append(np.column_stack((ends, headings)))
        return np.concatenate(parts)


def curves(start: Pose2D, goal: Pose2D, radius: float) -> List[Curve]:
    """Return the Reeds-Shepp curves from one pose to another, unsorted.

    Args:
        start, goal: In one frame.
        radius: Turning radius (m).
    """
    x, y, theta = goal.relative_to(start)
    x, y = x / radius, y / radius
    found = []
    for word in _words(x, y, theta):
        parts = [(turn, length) for turn, length in word if abs(length) > SHORT]
        if parts:
            found.append(Curve(parts, radius))
    return found


def _words(x: float, y: float, phi: float) -> Iterator[Word]:
    """Yield the words of every formula, and their time-flipped, reflected and time-flipped reflected forms."""
    for formula in FORMULAS:
        for word in formula(x, y, phi):
            yield word
        for word in formula(-x, y, -phi):
            yield [(turn, -length) for turn, length in word]
        for word in formula(x, -y, -phi):
            yield [(-turn, length) for turn, length in word]
        for word in formula(-x, -y, phi):
            yield [(-turn, -length) for turn, length in word]


def _polar(x: float, y: float) -> Tuple[float, float]:
    return math.hypot(x, y), math.atan2(y, x)


def _csc_same(x: float, y: float, phi: float) -> Iterator[Word]:
    """8.1: L+ S+ L+."""
    u, t = _polar(x - math.sin(phi), y - 1.0 + math.cos(phi))
    yield [(LEFT, t), (STRAIGHT, u), (LEFT, normalize_angle(phi - t))]


def _csc_other(x: float, y: float, phi: float) -> Iterator[Word]:
    """8.2: L+ S+ R+."""
    rho, theta = _polar(x + math.sin(phi), y - 1.0 - math.cos(phi))
    if rho >= 2.0:
        u = math.sqrt(rho * rho - 4.0)
        t = normalize_angle(theta + math.atan2(2.0, u))
        yield [(LEFT, t), (STRAIGHT, u), (RIGHT, normalize_angle(t - phi))]


def _ccc(x: float, y: float, phi: float) -> Iterator[Word]:
    """8.3 and 8.4: L+ R- L+, L+ R- L-, L+ R+ L-."""
    rho, theta = _polar(x - math.sin(phi), y - 1.0 + math.cos(phi))
    if rho > 4.0:
        return
    bend = math.acos(rho / 4.0)
    t, u = normalize_angle(theta + math.pi / 2.0 + bend), math.pi - 2.0 * bend
    yield [(LEFT, t), (RIGHT, -u), (LEFT, normalize_angle(phi - t - u))]
    if rho > 0.0:
        u = math.acos(1.0 - rho * rho / 8.0)
        bend = math.asin(min(1.0, 2.0 * math.sin(u) / rho))
        t = normalize_angle(theta + math.pi / 2.0 - bend)
        yield [(LEFT, t), (RIGHT, u), (LEFT, -normalize_angle(t - u - phi))]


def _cccc(x: float, y: float, phi: float) -> Iterator[Word]:
    """8.7 and 8.8: L+ R+ L- R-, L+ R- L- R+, with both middle segments of one length."""
    rho, theta = _polar(x + math.sin(phi), y - 1.0 - math.cos(phi))
    if rho <= 4.0:
        if rho <= 2.0:
            bend = math.acos((rho + 2.0) / 4.0)
            t, u = normalize_angle(theta + math.pi / 2.0 + bend), bend
        else:
            bend = math.acos((rho - 2.0) / 4.0)
            t, u = normalize_angle(theta + math.pi / 2.0 - bend), math.pi - bend
        yield [(LEFT, t), (RIGHT, u), (LEFT, -u), (RIGHT, -normalize_angle(phi - t + 2.0 * u))]
    cos = (20.0 - rho * rho) / 16.0
    if rho > 0.0 and 0.0 <= cos <= 1.0:
        u = math.acos(cos)
        bend = math.asin(min(1.0, 2.0 * math.sin(u) / rho))
        t = normalize_angle(theta + math.pi / 2.0 + bend)
        yield [(LEFT, t), (RIGHT, -u), (LEFT, -u), (RIGHT, normalize_angle(t - phi))]


def _ccsc(x: float, y: float, phi: float) -> Iterator[Word]:
    """8.9 and 8.10, with a quarter circle next to the cusp: L+ R- S- L-, L+ R- S- R-, and in reverse order."""
    quarter = math.pi / 2.0
    rho, theta = _polar(x - math.sin(phi), y - 1.0 + math.cos(phi))
    if rho >= 2.0:
        u = math.sqrt(rho * rho - 4.0) - 2.0
        t = normalize_angle(theta + quarter + math.atan2(2.0, u + 2.0))
        yield [(LEFT, t), (RIGHT, -quarter), (STRAIGHT, -u), (LEFT, -normalize_angle(t - phi + quarter))]
        t = normalize_angle(theta + quarter - math.atan2(u + 2.0, 2.0))
        yield [(LEFT, t), (STRAIGHT, u), (RIGHT, quarter), (LEFT, -normalize_angle(t - phi - quarter))]
    rho, theta = _polar(x + math.sin(phi), y - 1.0 - math.cos(phi))
    if rho >= 2.0:
        t = normalize_angle(theta + quarter)
        yield [(LEFT, t), (RIGHT, -quarter), (STRAIGHT, 2.0 - rho), (RIGHT, -normalize_angle(phi - t - quarter))]
        t = normalize_angle(theta)
        yield [(LEFT, t), (STRAIGHT, rho - 2.0), (LEFT, quarter), (RIGHT, -normalize_angle(phi - t - quarter))]


def _ccscc(x: float, y: float, phi: float) -> Iterator[Word]:
    """8.11: L+ R- S- L- R+, with a quarter circle before and after the straight."""
    quarter = math.pi / 2.0
    rho, theta = _polar(x + math.sin(phi), y - 1.0 - math.cos(phi))
    if rho >= 4.0:
        u = math.sqrt(rho * rho - 4.0) - 4.0
        t = normalize_angle(theta + quarter + math.atan2(2.0, u + 4.0))
        yield [(LEFT, t), (RIGHT, -quarter), (STRAIGHT, -u), (LEFT, -quarter), (RIGHT, normalize_angle(t - phi))]


FORMULAS: Tuple[Callable[[float, float, float], Iterator[Word]], ...] = (
    _csc_same, _csc_other, _ccc, _cccc, _ccsc, _ccscc)

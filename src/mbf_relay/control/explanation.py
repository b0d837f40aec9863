"""Explanation of a scoring: what each critic ruled out, and which one decided for the winner."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Dict, Iterable, Optional, Sequence, Tuple

import numpy as np

from mbf_relay.geometry import Twist2D

if TYPE_CHECKING:
    from mbf_relay.control.critics.critic import Critic


@dataclass(frozen=True)
class Explanation:
    """The scores of one cycle.

    Attributes:
        critics: In the order of the scores.
        scores: Shape (C, N): weighted cost by critic and trajectory; inf where ruled out.
        velocities: Shape (N, 3): the velocities sampled; the last one is standing still, which never wins.
        winner: Index of the trajectory chosen; None where all were ruled out.
    """

    critics: Tuple[Critic, ...]
    scores: np.ndarray
    velocities: np.ndarray
    winner: Optional[int]

    @staticmethod
    def of(critics: Sequence[Critic], scores: np.ndarray, velocities: np.ndarray) -> Explanation:
        """Return the explanation of scores (C, N); the winner is the trajectory of the lowest sum."""
        totals = scores.sum(axis=0)[:-1]
        winner = int(np.argmin(totals)) if len(totals) and np.isfinite(totals).any() else None
        return Explanation(tuple(critics), scores, velocities, winner)

    @property
    def names(self) -> Tuple[str, ...]:
        """The critics' names."""
        return tuple(critic.name for critic in self.critics)

    @cached_property
    def judges_place(self) -> np.ndarray:
        """Which critics have `judges_place`, bool of shape (C,)."""
        return np.array([critic.judges_place for critic in self.critics], dtype=bool)

    def where_held(self) -> Explanation:
        """Return the explanation without critics that have `yields_where_held`."""
        return self._without(critic.yields_where_held for critic in self.critics)

    def once_passed(self) -> Explanation:
        """Return the explanation without critics that have `passes_by_itself`."""
        return self._without(critic.passes_by_itself for critic in self.critics)

    def without_charges_for_the_way(self) -> Explanation:
        """Return the explanation with finite scores of critics that have `judges_way` set to 0."""
        scores = self.scores.copy()
        for critic, row in zip(self.critics, scores):
            if critic.judges_way:
                row[np.isfinite(row)] = 0.0
        return Explanation.of(self.critics, scores, self.velocities)

    def _without(self, left_out: Iterable[bool]) -> Explanation:
        out = np.fromiter(left_out, dtype=bool, count=len(self.critics))
        if not self.scores[out].any():  # they scored nothing, as in most cycles
            return self
        kept = np.flatnonzero(~out)
        return Explanation.of([self.critics[index] for index in kept], self.scores[kept], self.velocities)

    @property
    def totals(self) -> np.ndarray:
        """Total cost of each trajectory, shape (N,)."""
        totals: np.ndarray = self.scores.sum(axis=0)
        return totals

    @property
    def ruled_out(self) -> Dict[str, int]:
        """Number of trajectories that each critic ruled out; those ruled out by several count with each."""
        return {critic.name: int(np.isinf(row[:-1]).sum()) for critic, row in zip(self.critics, self.scores)}

    def runner_up(self) -> Optional[int]:
        """Return the index of the best clearly different trajectory: by a tenth of the window in some component."""
        if self.winner is None:
            return None
        spread = np.ptp(self.velocities, axis=0)
        apart = np.abs(self.velocities - self.velocities[self.winner]) > 0.1 * spread + 1e-9
        totals = np.where(apart.any(axis=1), self.totals, np.inf)[:-1]
        best = int(np.argmin(totals))
        return best if np.isfinite(totals[best]) else None

    def __str__(self) -> str:
        """Return one line for a log."""
        out = ", ".join(f"{name} {count}" for name, count in self.ruled_out.items() if count) or "none"
        text = f"{len(self.velocities) - 1} trajectories; ruled out: {out}"
        if self.winner is None:
            return f"{text}; nothing is left"
        text += f"; chosen {_velocity(self.velocities[self.winner])} at {self.totals[self.winner]:.2f}"
        other = self.runner_up()
        if other is None:
            return text
        lead = self.scores[:, other] - self.scores[:, self.winner]
        decisive = int(np.argmax(lead))
        return (
            f"{text}, ahead of {_velocity(self.velocities[other])} at {self.totals[other]:.2f} "
            f"mostly by {self.critics[decisive].name} ({lead[decisive]:+.2f})"
        )


def _velocity(velocity: np.ndarray) -> str:
    twist = Twist2D(*map(float, velocity))
    return f"({twist.x:.2f} m/s, {twist.y:.2f} m/s, {twist.theta:.2f} rad/s)"

"""What a robot touched on its way, how often, and whether it had moved towards it: by the simulator's truth."""

from __future__ import annotations

from typing import Iterable, List, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D, angle_between
from mbf_relay.simulation.contacts import Contact
from mbf_relay.touching import Touched

STANDING = 0.01
"""Closing speed (m/s) below which a robot has not moved towards what touches it: what a robot trembles by at rest."""

Sample = Tuple[float, Pose2D]
"""A time (s) and where the robot truly was."""


class Touches:
    """Counts touches, and those of them that are the robot's own fault.

    A touch is the robot's fault where the part of its hull that touches had moved towards the thing, however fast the
    thing came along. Where the robot stood or gave way, whoever came is at fault.

    Attributes:
        times: When (s) each touch began.
        at_fault: Of them, those that are the robot's fault.
        first: The first of them for people, empty before one.
    """

    def __init__(self) -> None:
        self.times: List[float] = []
        self.at_fault = 0
        self.first = ""
        self._touched = Touched()

    def note(self, now: float, contacts: Iterable[Contact], before: Sample, pose: Pose2D) -> None:
        """Note what is touched at one moment.

        Args:
            now: Time (s).
            contacts: What is touched; of one thing, the first counts.
            before: When and where the robot was a moment ago, before it touched this.
            pose: Where it is, in the world's frame as `before`.
        """
        for contact in contacts:
            if not self._touched.is_anew(contact.name, now):
                continue
            fault = closing_speed(contact, before, (now, pose)) >= STANDING
            self.times.append(now)
            self.at_fault += fault
            self.first = self.first or f"touched {contact.name}" + ("" if fault else ", which came to the robot")


def closing_speed(contact: Contact, before: Sample, now: Sample) -> float:
    """Return the speed (m/s) at which the part of the hull that touches has moved towards the thing it touches.

    Args:
        contact: Where and which way.
        before, now: Two samples of the robot's way.
    """
    elapsed = now[0] - before[0]
    if elapsed <= 0.0:
        return 0.0
    turn = angle_between(before[1].theta, now[1].theta) / elapsed
    arm = np.array(contact.position[:2]) - now[1][:2]
    velocity = (np.array(now[1][:2]) - before[1][:2]) / elapsed + turn * np.array((-arm[1], arm[0]))
    return -float(velocity @ contact.normal[:2])

"""Contacts of a drive, and which of them are the robot's fault, by the simulator's true poses."""

from __future__ import annotations

from typing import Iterable, List, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D, angle_between
from mbf_relay.simulation.contacts import Contact
from mbf_relay.touching import Touched

STANDING = 0.01
"""Closing speed (m/s) below which a contact is not the robot's fault; the physics of a robot at rest jitters by less.
"""

Sample = Tuple[float, Pose2D]
"""A time (s) and the robot's true pose."""


class Touches:
    """Counts contacts, and those that are the robot's fault.

    A contact is the robot's fault where the touching part of its hull had moved towards the body, however fast that
    moved itself. Where the robot stood or retreated, the other is at fault.

    Attributes:
        times: Time (s) at which each contact began.
        at_fault: Number of contacts that are the robot's fault.
        first: Description of the first contact; empty before.
    """

    def __init__(self) -> None:
        self.times: List[float] = []
        self.at_fault = 0
        self.first = ""
        self._touched = Touched()

    def note(self, now: float, contacts: Iterable[Contact], before: Sample, pose: Pose2D) -> None:
        """Take the contacts at one time.

        Args:
            now: Time (s).
            contacts: Contacts at that time; of one body only the first counts.
            before: The last sample before the contact.
            pose: The true pose now, in the world's frame as `before`.
        """
        for contact in contacts:
            if not self._touched.is_anew(contact.name, now):
                continue
            fault = closing_speed(contact, before, (now, pose)) >= STANDING
            self.times.append(now)
            self.at_fault += fault
            self.first = self.first or f"touched {contact.name}" + ("" if fault else ", which came to the robot")


def closing_speed(contact: Contact, before: Sample, now: Sample) -> float:
    """Return the speed (m/s) at which the touching point of the hull moved towards the body between two samples.

    Args:
        contact: Position and normal of the contact.
        before, now: The robot's time and pose before, and at the contact.
    """
    elapsed = now[0] - before[0]
    if elapsed <= 0.0:
        return 0.0
    turn = angle_between(before[1].theta, now[1].theta) / elapsed
    arm = np.array(contact.position[:2]) - now[1][:2]
    velocity = (np.array(now[1][:2]) - before[1][:2]) / elapsed + turn * np.array((-arm[1], arm[0]))
    return -float(velocity @ contact.normal[:2])

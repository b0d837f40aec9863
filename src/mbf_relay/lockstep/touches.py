"""Contacts of a drive, and which of them are the robot's fault, by the simulator's true poses."""

from __future__ import annotations

from typing import List, Sequence, Tuple

from mbf_relay.geometry import STOP, Pose2D, Twist2D
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
    moved itself. Where the robot stood or retreated, or something else pushed it there, the other is at fault.

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

    def note(
        self, now: float, contacts: Sequence[Contact], before: Sample, pose: Pose2D, commanded: Twist2D
    ) -> None:
        """Take the contacts at one time.

        Args:
            now: Time (s).
            contacts: Contacts at that time; of one body only the first counts.
            before: The last sample before the contact.
            pose: The true pose now, in the world's frame as `before`.
            commanded: The last command; where something touches the robot already, that may be what moves it.
        """
        elapsed = now - before[0]
        moved = Twist2D(*before[1].relative_to(pose)).scaled(-1.0 / elapsed) if elapsed > 0.0 else STOP
        begun = [contact for contact in contacts if self._touched.note_contact(contact.name, now)]
        is_touched = len({contact.name for contact in contacts}) > len(begun)
        motions = (moved, commanded) if is_touched else (moved,)
        for contact in begun:
            fault = min(closing_speed(contact, pose, motion) for motion in motions) >= STANDING
            self.times.append(now)
            self.at_fault += fault
            self.first = self.first or f"touched {contact.name}" + ("" if fault else ", which came to the robot")


def closing_speed(contact: Contact, pose: Pose2D, velocity: Twist2D) -> float:
    """Return the speed (m/s) at which the touching point of the hull moves towards the body.

    Args:
        contact: Position and normal of the contact.
        pose: The robot's.
        velocity: The robot's, body frame.
    """
    x, y = contact.position[0] - pose.x, contact.position[1] - pose.y
    ahead, aside, _ = Pose2D(0.0, 0.0, pose.theta).compose(Pose2D(velocity.x, velocity.y, 0.0))
    across, up, _ = contact.normal
    return -((ahead - velocity.theta * y) * across + (aside + velocity.theta * x) * up)

"""Does a robot that reacts and brakes keep its footprint clear of points, and from which share of a velocity?"""

from __future__ import annotations

import math
from typing import Optional, Tuple

import numpy as np

from mbf_relay.control.stopping import seconds_to_brake, way_to_a_stand
from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters
from mbf_relay.costmap.outline import OWN_DEPTH, clearances, radii
from mbf_relay.geometry import Twist2D

STEP = 0.01
"""Largest way (m) of a footprint's corner between two poses checked: about a lidar's accuracy."""
MOST_STEPS = 400
"""Most poses checked. On a longer way to a stop they lie farther apart, up to half the footprint's width, so that it
still covers the ground between; a velocity that needs more is slowed down."""
LEAST = 0.1
"""Share of a velocity below which the robot is stopped instead of slowed down: it would creep up to the obstacle."""
HALVINGS = 7
"""Bisection steps for the share of a velocity that may pass: they find it to less than a hundredth."""
TOUCH = 1e-9
"""Tolerance (m) for rounding errors."""


class BrakingCheck:
    """Moves a footprint along the way on which the robot reacts and brakes.

    Args:
        parameters: Decelerations, reaction time and margin.
        outline: The robot's, padded, shape (K, 2) in metres, in the base frame.

    Attributes:
        outline: The robot's.
        inscribed_radius, radius: Distances (m) from the base to the outline's nearest edge and its farthest corner.
    """

    def __init__(self, parameters: VelocityGuardParameters, outline: np.ndarray) -> None:
        self._parameters, self.outline = parameters, outline
        self.inscribed_radius, self.radius = radii(outline)
        self._longest = MOST_STEPS * max(STEP, 0.5 * float(np.ptp(outline, axis=0).min()))  # way to a stop (m)

    def seconds(self, velocity: Twist2D) -> float:
        """Return the time (s) to brake from a velocity, without the reaction."""
        p = self._parameters
        return seconds_to_brake(velocity, p.acc_lim_x, p.acc_lim_theta, p.wheel_separation)

    def way(self, velocity: Twist2D, seconds: float) -> float:
        """Return the longest way (m) of any corner of the footprint with a velocity held for `seconds`."""
        return (velocity.speed() + abs(velocity.theta) * self.radius) * seconds

    def reach(self, velocity: Twist2D) -> float:
        """Return the distance (m) from the base beyond which no point can be met; infinite where the way is too long.

        While a robot brakes, its base frame's origin is never faster than before.
        """
        p, braking = self._parameters, self.seconds(velocity)
        if self.way(velocity, p.reaction_time + 0.5 * braking) > self._longest:
            return math.inf
        return velocity.speed() * (p.reaction_time + braking) + self.radius + p.margin

    def free_share(self, asked: Twist2D, points: np.ndarray) -> Tuple[float, str]:
        """Return the largest share of a velocity that leaves room to brake, and what is in the way, if anything."""
        in_the_way = self.in_the_way(asked, points)
        if not in_the_way:
            return 1.0, ""
        share, blocked = 0.0, 1.0
        for _ in range(HALVINGS):
            middle = 0.5 * (share + blocked)
            if self.in_the_way(asked.scaled(middle), points):
                blocked = middle
            else:
                share = middle
        return share if share >= LEAST else 0.0, in_the_way

    def in_the_way(self, velocity: Twist2D, points: np.ndarray) -> str:
        """Return what the robot would come too near to while it reacts and brakes; empty for nothing."""
        p = self._parameters
        seconds = p.reaction_time + 0.5 * self.seconds(velocity)
        way = self.way(velocity, seconds)
        if way > self._longest:
            return f"the way to a stop is longer than {self._longest:.1f} m"
        count = 1 + int(min(way / STEP, MOST_STEPS))
        poses = np.array([velocity.held(seconds * step / count) for step in range(1, count + 1)])
        if p.wheel_separation > 0.0:
            step = max(STEP, way / MOST_STEPS)
            begin = velocity.held(p.reaction_time)
            braked = way_to_a_stand(begin, velocity, p.wheel_separation, p.acc_lim_x, step, step / self.radius)
            poses = np.concatenate((poses, braked))
        point = self.too_near(poses, points, p.margin)
        return "" if point is None else self.something_at(point)

    def something_at(self, point: np.ndarray) -> str:
        """Return a point, shape (2,), as text."""
        return f"something at ({point[0]:.2f}, {point[1]:.2f}) m from {self._parameters.base_frame}"

    def too_near(self, poses: np.ndarray, points: np.ndarray, margin: float) -> Optional[np.ndarray]:
        """Return the first of `points`, (N, 2), that the footprint comes too near to along poses (P, 3), or None.

        A point that is nearer than `margin` (m) now, with the robot at the origin, may not come nearer.
        """
        reach = float(np.hypot(poses[:, 0], poses[:, 1]).max()) + self.radius + margin
        near = points[np.hypot(points[:, 0], points[:, 1]) <= reach]
        if not len(near):  # the usual case; what follows takes longer
            return None
        before = clearances(near, self.outline)
        near, before = near[before > -OWN_DEPTH], before[before > -OWN_DEPTH]
        off, reach = near - poses[:, None, :2], self.radius + margin + TOUCH  # what lies beyond is not too near there
        which, point = np.nonzero(off[..., 0] ** 2 + off[..., 1] ** 2 <= reach * reach)
        (x, y), turned = off[which, point].T, poses[which, 2]
        cosine, sine = np.cos(turned), np.sin(turned)
        after = clearances(np.column_stack((cosine * x + sine * y, cosine * y - sine * x)), self.outline)
        too_near = after < np.minimum(margin, before[point]) - TOUCH
        if not too_near.any():
            return None
        first: np.ndarray = near[point[np.argmax(too_near)]]
        return first

# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loop of the differential motion model."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel


@kernel("void(float64[:,::1], float64[:,::1], float64[::1], float64[::1], float64[:,::1])")
def turn_drive_turn(poses, noise, motion, deviations, moved):
    """Turn each pose, move it ahead and turn it again, by odometry's values plus noise (table 5.6).

    Args:
        poses: Shape (N, 3).
        noise: Standard normal, shape (3, N).
        motion: The first turn (rad), the translation (m) and the second turn (rad), shape (3,).
        deviations: Standard deviations of the three, shape (3,).
        moved: Result, shape (N, 3), headings in [-pi, pi).
    """
    for i in range(poses.shape[0]):
        heading = poses[i, 2] + (motion[0] + noise[0, i] * deviations[0])
        distance = motion[1] + noise[1, i] * deviations[1]
        moved[i, 0] = poses[i, 0] + distance * math.cos(heading)
        moved[i, 1] = poses[i, 1] + distance * math.sin(heading)
        turned = heading + (motion[2] + noise[2, i] * deviations[2]) + np.pi
        moved[i, 2] = turned - 2.0 * np.pi * math.floor(turned / (2.0 * np.pi)) - np.pi

# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops of MPPI: simulation of samples, and their weighted mean."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel


@kernel(
    "void(float64[::1], float64[::1], float64[:,::1], float32[:,:,::1], float64[::1], float64[::1], float64[::1], "
    "float64, float64, float64[:,:,::1], float64[:,:,::1], float64[:,:,::1])"
)
def roll_out(
    pose, velocity, controls, noises, low, high, accelerations, turning_radius, step, samples, velocities, poses
):
    """Simulate each sample of the control sequence.

    In each step the velocity moves towards the sampled control within the acceleration limits and is then held; the
    step is the exact arc, with its sine and cosine as series up to the fifth power of the angle.

    Args:
        pose: Shape (3,): x, y (m), theta (rad) at the start.
        velocity: Shape (3,), body frame, at the start.
        controls: Shape (T, 3): the mean, body frame.
        noises: Shape (B, T, 3): noise added to it.
        low, high: Shape (3,): velocity limits. Controls beyond them are driven at the limit, but kept as drawn in
            `samples`: with these limited as well, their mean could never reach the limit.
        accelerations: Shape (3,): limits (m/s^2, m/s^2, rad/s^2).
        turning_radius: Minimum turning radius (m); 0 for a robot that turns on the spot.
        step: Duration (s) of a step.
        samples: Shape (B, T, 3): filled with the sampled controls.
        velocities: Shape (B, T, 3): filled with the velocities of each step.
        poses: Shape (B, T, 3): filled with the poses after each step.
    """
    batch, count = noises.shape[0], noises.shape[1]
    for b in range(batch):
        x, y, theta = pose[0], pose[1], pose[2]
        cos, sin = math.cos(theta), math.sin(theta)
        now_x, now_y, now_turn = velocity[0], velocity[1], velocity[2]
        for t in range(count):
            for component in range(3):
                samples[b, t, component] = controls[t, component] + noises[b, t, component]
            along = min(high[0], max(low[0], samples[b, t, 0]))
            aside = min(high[1], max(low[1], samples[b, t, 1]))
            turn = min(high[2], max(low[2], samples[b, t, 2]))
            change = accelerations[0] * step
            now_x = min(now_x + change, max(now_x - change, along))
            change = accelerations[1] * step
            now_y = min(now_y + change, max(now_y - change, aside))
            change = accelerations[2] * step
            now_turn = min(now_turn + change, max(now_turn - change, turn))
            if turning_radius > 0.0:
                most = abs(now_x) / turning_radius
                now_turn = min(most, max(-most, now_turn))
            velocities[b, t, 0], velocities[b, t, 1], velocities[b, t, 2] = now_x, now_y, now_turn
            angle = now_turn * step
            square = angle * angle
            turn_cos = 1.0 - square * (0.5 - square / 24.0)
            turn_sin = angle * (1.0 - square * (1.0 / 6.0 - square / 120.0))
            straight = step * (1.0 - square / 6.0)  # sin(angle) / turn
            bent = step * angle * (0.5 - square / 24.0)  # (1 - cos(angle)) / turn
            ahead = now_x * straight - now_y * bent
            left = now_x * bent + now_y * straight
            x += cos * ahead - sin * left
            y += sin * ahead + cos * left
            theta += angle
            cos, sin = cos * turn_cos - sin * turn_sin, sin * turn_cos + cos * turn_sin
            poses[b, t, 0], poses[b, t, 1], poses[b, t, 2] = x, y, theta


@kernel(
    "float64(float64[::1], float64[:,:,::1], float64[::1], float64, float64, float64[::1], float64[::1], "
    "float64[:,::1])"
)
def blend(costs, samples, deviations, temperature, gamma, low, high, controls):
    """Replace the controls by the mean of the samples, weighted by exp(-cost / temperature).

    Return the effective sample size.

    Source: Williams et al., "Information-theoretic model predictive control" (2018), algorithm 2.

    Args:
        costs: Shape (B,), finite.
        samples: Shape (B, T, 3).
        deviations: Shape (3,): standard deviations of the noise, above 0.
        temperature, gamma: See MppiParameters.
        low, high: Shape (3,): velocity limits, to which the mean is cut.
        controls: Shape (T, 3): the mean that the samples were drawn round; filled with the new one.
    """
    batch, count = samples.shape[0], samples.shape[1]
    weights = np.empty(batch)
    lowest = math.inf
    for b in range(batch):
        strayed = 0.0
        if gamma > 0.0:
            for component in range(3):
                scale = gamma / (deviations[component] * deviations[component])
                for t in range(count):
                    mean = controls[t, component]
                    strayed += scale * mean * (samples[b, t, component] - mean)
        weights[b] = costs[b] + strayed
        lowest = min(lowest, weights[b])
    total, squares = 0.0, 0.0
    for b in range(batch):
        weights[b] = math.exp(-(weights[b] - lowest) / temperature)
        total += weights[b]
        squares += weights[b] * weights[b]
    controls[:] = 0.0
    for b in range(batch):
        share = weights[b] / total
        if share > 1e-9:
            for t in range(count):
                for component in range(3):
                    controls[t, component] += share * samples[b, t, component]
    for t in range(count):
        for component in range(3):
            controls[t, component] = min(high[component], max(low[component], controls[t, component]))
    return total * total / squares

# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops over batches of trajectories: sampling, forward simulation, ends and stopping distances."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel


@kernel("int64(float64, float64, int64, float64[::1])")
def axis(low, high, count, values):
    """Fill `values` with `count` values from low to high, and zero if that lies between; return their number."""
    if high - low < 1e-9:
        values[0] = high
        return 1
    step = (high - low) / (count - 1)
    filled, has_zero = 0, not low < 0.0 < high
    for i in range(count):
        value = high if i == count - 1 else i * step + low
        if abs(value) < 1e-12:
            has_zero = True
        elif value > 0.0 and not has_zero:
            values[filled] = 0.0
            filled += 1
            has_zero = True
        values[filled] = value
        filled += 1
    return filled


@kernel("int64(float64[::1], float64[::1], int64[::1], float64, float64[:,::1])")
def sample(low, high, counts, fastest, velocities):
    """Fill `velocities` with every combination of evenly spaced components; return their number.

    Args:
        low, high: Shape (3,): range of each component (m/s, m/s, rad/s).
        counts: Shape (3,), each 2 or above: values of each component; zero is added where it lies between.
        fastest: Translational speed (m/s) above which a combination is left out; standing still is left out, too.
        velocities: Shape (M, 3) with room for all, filled from the front; the last component varies fastest.
    """
    axes = np.empty((3, counts.max() + 1))
    lengths = np.empty(3, np.int64)
    for component in range(3):
        lengths[component] = axis(low[component], high[component], counts[component], axes[component])
    found = 0
    for i in range(lengths[0]):
        for j in range(lengths[1]):
            speed = math.hypot(axes[0, i], axes[1, j])
            if speed > fastest:
                continue
            for k in range(lengths[2]):
                if speed < 1e-6 and abs(axes[2, k]) < 1e-6:
                    continue
                velocities[found, 0] = axes[0, i]
                velocities[found, 1] = axes[1, j]
                velocities[found, 2] = axes[2, k]
                found += 1
    return found


@kernel("void(float64[:,::1], float64[::1], float64[::1], float64, float64, float64, float64, boolean[::1])")
def too_slow(velocities, lowest, highest, fastest, standing, least, least_turn, result):
    """Mark velocities slower than `least` (m/s) that turn less than `least_turn` (rad/s); see trajectories.too_slow.

    Args:
        velocities: Shape (N, 3), body frame.
        lowest, highest: Shape (2,): velocity limits (m/s) along x and y; velocities at these are not marked.
        fastest: Highest speed (m/s) of the window; velocities of that speed are not marked.
        standing: Speed (m/s) up to which a velocity counts as a turn on the spot and is not marked.
        least, least_turn: See above.
        result: Shape (N,), filled.
    """
    for n in range(velocities.shape[0]):
        x, y = velocities[n, 0], velocities[n, 1]
        along_x = -lowest[0] if x < 0.0 else highest[0]
        along_y = -lowest[1] if y < 0.0 else highest[1]
        speed = math.hypot(x, y)
        result[n] = (
            standing < speed < min(least, min(fastest, max(along_x, along_y))) - 1e-4
            and abs(velocities[n, 2]) < least_turn - 1e-4)


@kernel(
    "float64(float64[:,::1], float64[::1], float64, float64, float64, float64, float64, float64[::1], float64[::1], "
    "float64[::1])"
)
def time_spans(
    velocities,
    accelerations,
    delay,
    sim_time,
    distance_left,
    granularity,
    angular_granularity,
    speeds,
    stopping,
    durations,
):
    """Find the duration of each trajectory; return the largest number of steps.

    It is `sim_time`, or the longest stopping time of the batch if that is more; but no more than `distance_left` takes,
    unless stopping takes longer.

    Args:
        velocities: Shape (N, 3), body frame.
        accelerations: Shape (3,), all above 0.
        delay: Time (s) before braking begins.
        sim_time: Seconds.
        distance_left: Distance (m) to the goal.
        granularity: Largest step (m).
        angular_granularity: Largest step (rad).
        speeds: Shape (N,): filled with the translational speed (m/s).
        stopping: Shape (N,): filled with the time (s) at constant velocity that covers the delay and the way to brake.
        durations: Shape (N,): filled with seconds.
    """
    longest_stop = 0.0
    for n in range(velocities.shape[0]):
        speeds[n] = math.hypot(velocities[n, 0], velocities[n, 1])
        braking = 0.0
        for component in range(3):
            braking = max(braking, abs(velocities[n, component]) / (2.0 * accelerations[component]))
        stopping[n] = delay + braking
        longest_stop = max(longest_stop, stopping[n])
    steps = 1.0 if velocities.shape[0] == 0 else 0.0
    for n in range(velocities.shape[0]):
        durations[n] = max(sim_time, longest_stop)
        if speeds[n] > 1e-3:
            durations[n] = min(durations[n], max(distance_left / speeds[n], stopping[n]))
        steps = max(steps, durations[n] * speeds[n] / granularity)
        steps = max(steps, durations[n] * abs(velocities[n, 2]) / angular_granularity)
    return steps


@kernel(
    "void(float64[::1], float64[:,:,::1], int64[::1], int64[::1], float64[::1], float64[::1], float64[::1], "
    "float64[::1], float64, float64[:,::1], int64[::1], float64[::1])"
)
def outlook(pose, poses, counts, free, steps, stopping, durations, speeds, sim_time, ends, needed, spare):
    """Find of each trajectory its end, the number of poses that must be free, and the distance beyond the goal.

    Args:
        pose: Shape (3,): the robot's present pose.
        poses: Shape (N, S, 3).
        counts, free: Shape (N,): poses of each trajectory, and those before its first contact.
        steps: Shape (N,): duration of a step (s).
        stopping, durations: Shape (N,): seconds, from `time_spans`.
        speeds: Shape (N,): m/s.
        sim_time: Seconds.
        ends: Shape (N, 3): filled with the last free pose, the robot's own where none is free.
        needed: Shape (N,): filled with the poses that must be free for the robot to be able to stop.
        spare: Shape (N,): filled with the distance (m) left to drive within sim_time; 0 where it is not all free.
    """
    for n in range(poses.shape[0]):
        for component in range(3):
            ends[n, component] = poses[n, free[n] - 1, component] if free[n] > 0 else pose[component]
        needed[n] = min(counts[n], int(math.ceil(stopping[n] / steps[n] - 1e-9)))
        spare[n] = max(0.0, sim_time - durations[n]) * speeds[n] if free[n] == counts[n] else 0.0


@kernel(
    "void(float64[::1], float64[::1], float64[::1], float64[:,::1], float64[::1], float64, float64, "
    "float64[:,:,::1], int64[::1], float64[::1])"
)
def simulate(pose, velocity, accelerations, targets, durations, granularity, angular_granularity, poses, counts, steps):
    """Drive a batch of velocities forward.

    Each velocity component moves from `velocity` to the target's at its acceleration; within a step it is constant, and
    the step is the exact arc.

    Args:
        pose: Shape (3,): x, y (m), theta (rad) at the start.
        velocity: Shape (3,), body frame; give NaN in [0] where the targets hold from the start.
        accelerations: Shape (3,), all above 0.
        targets: Shape (N, 3): velocities in the body frame.
        durations: Shape (N,) in seconds.
        granularity: Largest step (m).
        angular_granularity: Largest step (rad).
        poses: Shape (N, S, 3): filled with the pose after each step, counts[n] of them.
        counts: Shape (N,): filled with the number of steps, 1 to S.
        steps: Shape (N,): filled with the duration of a step (s).
    """
    at_once = math.isnan(velocity[0])
    most = poses.shape[1]
    for n in range(targets.shape[0]):
        target_x, target_y, target_turn = targets[n, 0], targets[n, 1], targets[n, 2]
        need = max(
            math.hypot(target_x, target_y) * durations[n] / granularity,
            abs(target_turn) * durations[n] / angular_granularity,
        )
        count = min(most, max(1, int(math.ceil(need - 1e-9))))
        step = durations[n] / count
        counts[n] = count
        steps[n] = step
        x, y, theta = pose[0], pose[1], pose[2]
        cos, sin = math.cos(theta), math.sin(theta)
        along_x = target_x if at_once else velocity[0]
        along_y = target_y if at_once else velocity[1]
        turn = target_turn if at_once else velocity[2]
        ahead, aside, turn_cos, turn_sin = 0.0, 0.0, 1.0, 0.0
        for i in range(count):
            if i == 0 or not at_once:
                if not at_once:
                    along_x += min(accelerations[0] * step, max(-accelerations[0] * step, target_x - along_x))
                    along_y += min(accelerations[1] * step, max(-accelerations[1] * step, target_y - along_y))
                    turn += min(accelerations[2] * step, max(-accelerations[2] * step, target_turn - turn))
                angle = turn * step
                turn_cos, turn_sin = math.cos(angle), math.sin(angle)
                if abs(angle) > 1e-6:
                    ahead = (along_x * turn_sin - along_y * (1.0 - turn_cos)) / turn
                    aside = (along_x * (1.0 - turn_cos) + along_y * turn_sin) / turn
                else:
                    ahead, aside = along_x * step, along_y * step
            x += cos * ahead - sin * aside
            y += sin * ahead + cos * aside
            theta += turn * step
            cos, sin = cos * turn_cos - sin * turn_sin, sin * turn_cos + cos * turn_sin
            poses[n, i, 0] = x
            poses[n, i, 1] = y
            poses[n, i, 2] = theta

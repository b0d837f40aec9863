"""Compiled loops over batches of trajectories: sampling, forward simulation, and the first contact of a footprint."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_LETHAL = 254


@kernel("int64(float64, float64, int64, float64[::1])")
def axis(low, high, count, values):
    """Fill `values` with `count` values from low to high and with zero where that lies between; return how many."""
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
    """Fill `velocities` with every combination of evenly spaced components; return how many.

    Args:
        low, high: Shape (3,): the ends of each component.
        counts: Shape (3,), each 2 or above: values along each component; zero comes besides where it lies between.
        fastest: Speed (m/s) beyond which a combination is left out; standing still is left out as well.
        velocities: Shape (M, 3) with room for all, filled from the front; the last component runs fastest.
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


@kernel(
    "float64(float64[:,::1], float64[::1], float64, float64, float64, float64, float64, float64[::1], float64[::1], "
    "float64[::1])"
)
def time_spans(
    velocities, accelerations, delay, sim_time, distance_left, granularity, angular_granularity, speeds, stopping, durations
):
    """Find how long each trajectory is followed; return the most steps any of them takes.

    It is followed for `sim_time`, or for as long as the slowest to stop needs for that; but no farther than
    `distance_left`, where the robot can have stopped by then.

    Args:
        velocities: Shape (N, 3), body frame.
        accelerations: Shape (3,), all above 0.
        delay: Seconds before braking begins.
        sim_time: Seconds.
        distance_left: Metres to the goal.
        granularity: Most metres per step.
        angular_granularity: Most radians per step.
        speeds: Shape (N,): filled with the translational speed (m/s).
        stopping: Shape (N,): filled with the time (s) until the robot could have stopped, braking over half of it.
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
    "void(float64[::1], float64[:,:,::1], int64[::1], int64[::1], float64[::1], float64[::1], float64[::1], float64[::1], "
    "float64, float64[:,::1], int64[::1], float64[::1])"
)
def outlook(pose, poses, counts, free, steps, stopping, durations, speeds, sim_time, ends, needed, spare):
    """Tell of each trajectory where it ends, how much of it must be free, and how much farther it would lead.

    Args:
        pose: Shape (3,): the robot now.
        poses: Shape (N, S, 3).
        counts, free: Shape (N,): poses of each trajectory, and those before its first contact.
        steps: Shape (N,): the length of a step (s).
        stopping, durations: Shape (N,): seconds, from `time_spans`.
        speeds: Shape (N,): m/s.
        sim_time: Seconds.
        ends: Shape (N, 3): filled with the last free pose, the robot's own where none is free.
        needed: Shape (N,): filled with the poses that must be free for the robot to be able to stop.
        spare: Shape (N,): filled with the metres it would drive on within sim_time, where it is free throughout.
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
        granularity: Most metres per step.
        angular_granularity: Most radians per step.
        poses: Shape (N, S, 3): filled with the pose after each step, counts[n] of them.
        counts: Shape (N,): filled with the number of steps, 1 to S.
        steps: Shape (N,): filled with the length of a step (s).
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


@kernel(
    "int64(uint8[:,::1], float32[:,::1], float64, float64, float64, float32[:,:,::1], float64, float64, float64, "
    "float64, float64, float64)"
)
def contacts(costs, distances, origin_x, origin_y, resolution, outlines, circumscribed, overlap, x, y, theta, scale):
    """Return how many points of a footprint's outline lie on a lethal or unknown cell, or outside the grid.

    Args:
        costs: Shape (H, W), uint8.
        distances: Shape (H, W): distance in cells from each cell's centre to that of the nearest lethal or unknown one.
        origin_x, origin_y, resolution: Where the cells lie.
        outlines: Shape (A, P, 2): points (m) round the outline, turned by each of A headings of a full circle.
        circumscribed: Radius (m) of the outline at scale 1.
        overlap: Share of a cell by which the outline may reach into an obstacle's cell from a free one beside it.
        x, y, theta: Pose of the base.
        scale: Factor on the outline.
    """
    height, width = costs.shape
    across = (x - origin_x) / resolution
    up = (y - origin_y) / resolution
    reach = circumscribed * scale / resolution
    inside = across - reach >= 0.0 and up - reach >= 0.0 and across + reach < width and up + reach < height
    if inside and distances[int(up), int(across)] > reach + 1.4143:
        return 0
    headings = outlines.shape[0]
    heading = int(math.floor(theta * headings / (2.0 * math.pi) + 0.5)) % headings
    factor = scale / resolution
    found = 0
    for point in range(outlines.shape[1]):
        in_x = across + factor * outlines[heading, point, 0]
        in_y = up + factor * outlines[heading, point, 1]
        column, row = int(math.floor(in_x)), int(math.floor(in_y))
        if column < 0 or row < 0 or column >= width or row >= height:
            found += 1
        elif costs[row, column] >= _LETHAL:
            in_x -= column
            in_y -= row
            grazes = (
                (in_x < overlap and column > 0 and costs[row, column - 1] < _LETHAL)
                or (in_x > 1.0 - overlap and column + 1 < width and costs[row, column + 1] < _LETHAL)
                or (in_y < overlap and row > 0 and costs[row - 1, column] < _LETHAL)
                or (in_y > 1.0 - overlap and row + 1 < height and costs[row + 1, column] < _LETHAL)
            )
            if not grazes:
                found += 1
    return found


@kernel(
    "void(uint8[:,::1], float32[:,::1], float64, float64, float64, float32[:,:,::1], float64, float64, "
    "float64[:,:,::1], int64[::1], float64[::1], int64, int64[::1], float64[::1], float64[::1])"
)
def first_contacts(
    costs, distances, origin_x, origin_y, resolution, outlines, circumscribed, overlap, poses, counts, scales, allowed,
    free, highest, summed,
):
    """Find how far along each trajectory the footprint stays free, and what cost its centre passes.

    Args:
        costs, distances, origin_x, origin_y, resolution, outlines, circumscribed, overlap: As for `contacts`.
        poses: Shape (N, S, 3).
        counts: Shape (N,): number of poses of each trajectory.
        scales: Shape (N,): factor on the footprint.
        allowed: Number of outline points in contact that is tolerated; it falls to what is left on the way.
        free: Shape (N,): filled with the number of poses before the first contact.
        highest, summed: Shape (N,): filled with the highest and the summed cost under the centre of these poses.
    """
    height, width = costs.shape
    for n in range(poses.shape[0]):
        tolerated = allowed
        free[n] = counts[n]
        highest[n] = 0.0
        summed[n] = 0.0
        for i in range(counts[n]):
            x, y = poses[n, i, 0], poses[n, i, 1]
            found = contacts(
                costs, distances, origin_x, origin_y, resolution, outlines, circumscribed, overlap, x, y,
                poses[n, i, 2], scales[n])
            if found > tolerated:
                free[n] = i
                break
            tolerated = min(tolerated, found)
            column = int(math.floor((x - origin_x) / resolution))
            row = int(math.floor((y - origin_y) / resolution))
            if column < 0 or row < 0 or column >= width or row >= height:
                free[n] = i
                break
            cost = float(costs[row, column])
            highest[n] = max(highest[n], cost)
            summed[n] += cost


@kernel("void(uint8[:,::1], float64, float64, float64, float64, float64, float64[:,::1], uint8[::1])")
def in_sight(costs, origin_x, origin_y, resolution, x, y, points, seen):
    """Mark the points whose straight line from (x, y) crosses no lethal or unknown cell; what is outside is not judged.

    Args:
        costs: Shape (H, W), uint8.
        origin_x, origin_y, resolution: Where the cells lie.
        x, y: Where from (m).
        points: Shape (N, 2) in metres.
        seen: Shape (N,): filled with 1 or 0.
    """
    height, width = costs.shape
    for n in range(points.shape[0]):
        dx, dy = points[n, 0] - x, points[n, 1] - y
        count = int(math.hypot(dx, dy) / (0.5 * resolution)) + 1
        seen[n] = 1
        for i in range(1, count + 1):
            column = int(math.floor((x + dx * i / count - origin_x) / resolution))
            row = int(math.floor((y + dy * i / count - origin_y) / resolution))
            if column < 0 or row < 0 or column >= width or row >= height:
                break
            if costs[row, column] >= _LETHAL:
                seen[n] = 0
                break


@kernel("float64(float32[:,::1], float64, float64, float64, float64[:,::1])")
def least_distance(distances, origin_x, origin_y, resolution, points):
    """Return the least of a grid's values at points, interpolated between the centres of cells; infinite for none.

    Args:
        distances: Shape (H, W), a value at each cell's centre.
        origin_x, origin_y, resolution: Where the cells lie.
        points: Shape (N, 2) in metres; those outside the outermost centres are left out.
    """
    height, width = distances.shape
    least = math.inf
    for n in range(points.shape[0]):
        across = (points[n, 0] - origin_x) / resolution - 0.5
        up = (points[n, 1] - origin_y) / resolution - 0.5
        if not (across >= 0.0 and up >= 0.0 and across < width - 1 and up < height - 1):
            continue
        column, row = int(across), int(up)
        across -= column
        up -= row
        lower = (1.0 - across) * distances[row, column] + across * distances[row, column + 1]
        upper = (1.0 - across) * distances[row + 1, column] + across * distances[row + 1, column + 1]
        least = min(least, (1.0 - up) * lower + up * upper)
    return least

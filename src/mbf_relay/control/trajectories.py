"""The dynamic window and the batch of trajectories sampled from it (Fox, Burgard, Thrun 1997; dwa_local_planner)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from mbf_relay.control import trajectory_kernels
from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.outcomes import ControlError, ControlOutcome

STANDING = 0.05  # of the top speed: slower than this a robot turns on the spot
NEVER = 1 << 30  # poses: no trajectory has as many free
MOST_POSES = 1000000
"""Poses of a batch: with as many, a cycle takes more than half a second."""


@dataclass(frozen=True)
class VelocityWindow:
    """The velocities in reach, body frame.

    Attributes:
        low, high: Lowest and highest of each component.
        still: The one that brakes as hard as can be. Where a lowest velocity is above zero it lies below the window:
            any robot may stand.
    """

    low: Twist2D
    high: Twist2D
    still: Twist2D

    @property
    def can_stand(self) -> bool:
        """Whether the robot may stand by the end of it."""
        return all(abs(value) <= 1e-9 for value in self.still)

    def clip(self, velocity: Twist2D) -> Twist2D:
        """Return the velocity in reach that is nearest, component by component."""
        return Twist2D(*(min(high, max(low, value)) for low, value, high in zip(self.low, velocity, self.high)))

    def clip_all(self, velocities: np.ndarray) -> np.ndarray:
        """Return `clip` of each row of velocities, shape (N, 3), to the sign of a zero."""
        raised: np.ndarray = np.where(velocities > self.low, velocities, self.low)
        return np.where(raised < self.high, raised, self.high)


def window_of(
    parameters: FollowerParameters, velocity: Twist2D, horizon: float, speed: float, turn: float
) -> VelocityWindow:
    """Return what can be reached from `velocity` within `horizon` seconds.

    Where the present velocity is beyond a limit, the window is the least that braking leaves.

    Args:
        parameters: Limits and accelerations.
        velocity: The present velocity.
        horizon: Seconds of acceleration.
        speed: Top translational speed (m/s) for now.
        turn: Top rotational speed (rad/s) for now.
    """
    p = parameters
    limits = (
        (max(p.min_vel_x, -speed), min(p.max_vel_x, speed), p.acc_lim_x),
        (max(p.min_vel_y, -speed), min(p.max_vel_y, speed), p.acc_lim_y),
        (-turn, turn, p.acc_lim_theta),
    )
    low, high, still = [], [], []
    for now, (lowest, highest, acceleration) in zip(velocity, limits):
        reach_low, reach_high = now - acceleration * horizon, now + acceleration * horizon
        low.append(min(reach_high, max(reach_low, lowest)))
        high.append(max(reach_low, min(reach_high, highest)))
        still.append(min(reach_high, max(reach_low, 0.0)))
    return VelocityWindow(Twist2D(*low), Twist2D(*high), Twist2D(*still))


def commandable(parameters: FollowerParameters, velocity: Twist2D, last: Twist2D) -> Twist2D:
    """Return what a measured velocity is to a controller: no more than could have been commanded.

    What lies beyond, as of a wheeled robot that slips sideways, or that coasts downhill, is nothing to brake bit by
    bit; and where odometry counts in another unit, each command would raise what is measured, and that the next one.

    Args:
        parameters: Limits.
        velocity: As odometry tells it.
        last: The last command, which may be beyond the limits where these were lowered since.
    """
    p = parameters
    limits = ((p.min_vel_x, p.max_vel_x), (p.min_vel_y, p.max_vel_y), (-p.max_vel_theta, p.max_vel_theta))
    return Twist2D(*(
        min(max(value, min(low, now, 0.0)), max(high, now, 0.0))
        for value, now, (low, high) in zip(velocity, last, limits)
    ))


def sample(parameters: DwaParameters, window: VelocityWindow, speed: float) -> np.ndarray:
    """Return velocities of the window, shape (N, 3): evenly spaced along each component, with its ends and zero.

    Left out are standing still and more than `speed` in all.
    """
    p = parameters
    counts = tuple(max(2, count) for count in (p.vx_samples, p.vy_samples, p.vth_samples))
    require_room(math.prod(count + 1 for count in counts), 1)
    slowest = math.hypot(*(min(abs(low), abs(high)) if low * high > 0.0 else 0.0
                           for low, high in zip(window.low[:2], window.high[:2])))
    velocities = np.empty(((counts[0] + 1) * (counts[1] + 1) * (counts[2] + 1), 3))  # each has room for zero besides
    found = trajectory_kernels.sample(
        np.array(window.low), np.array(window.high), np.array(counts), max(speed, slowest) + 1e-4, velocities)
    return velocities[:found]


def is_fastest(window: VelocityWindow, velocity: np.ndarray) -> bool:
    """Return whether a velocity, (3,), is as fast as the window allows: the robot starts, or must be slow here."""
    fastest = max(abs(window.low.x), abs(window.high.x), abs(window.low.y), abs(window.high.y))
    return bool(np.hypot(velocity[0], velocity[1]) >= fastest - 1e-4)


def too_slow(parameters: DwaParameters, window: VelocityWindow, velocities: np.ndarray) -> np.ndarray:
    """Tell of each velocity, (N, 3), whether it creeps.

    Translates slower than min_vel_trans, turning less than min_vel_theta.

    What is as fast as the window allows does not: the robot starts, or must be slow here; nor what is as fast as it
    ever drives in that direction. A turn on the spot is no creeping; how fast it is, is not decided by sampling.
    """
    p = parameters
    fastest = max(abs(window.low.x), abs(window.high.x), abs(window.low.y), abs(window.high.y))
    creeping = np.empty(len(velocities), np.bool_)
    trajectory_kernels.too_slow(
        np.ascontiguousarray(velocities), np.array((p.min_vel_x, p.min_vel_y)), np.array((p.max_vel_x, p.max_vel_y)),
        fastest, STANDING * p.max_vel_trans, p.min_vel_trans, p.min_vel_theta, creeping)
    return creeping


@dataclass(frozen=True)
class Trajectories:
    """A batch of N trajectories of up to S poses, in the costmap's frame.

    Attributes:
        velocities: Shape (N, 3): the velocity sampled.
        commands: Shape (N, 3): the velocity to command for it now; within accelerations.
        poses: Shape (N, S, 3): poses after each step.
        counts: Shape (N,): poses simulated; the trajectory stops at the goal.
        steps: Shape (N,): seconds from pose to pose.
        free: Shape (N,): poses before the first contact.
        needed: Shape (N,): poses that must be free for the robot to be able to stop.
        ends: Shape (N, 3): the last free pose, the robot's own where none is free.
        spare: Shape (N,): metres it would drive on within sim_time, were the goal not where it stops.
        highest_costs, summed_costs: Shape (N,): cost under the centre, over the free poses.
    """

    velocities: np.ndarray
    commands: np.ndarray
    poses: np.ndarray
    counts: np.ndarray
    steps: np.ndarray
    free: np.ndarray
    needed: np.ndarray
    ends: np.ndarray
    spare: np.ndarray
    highest_costs: np.ndarray
    summed_costs: np.ndarray

    def __len__(self) -> int:
        return len(self.velocities)

    @property
    def driven(self) -> np.ndarray:
        """How far (m) each drives to its end, shape (N,), were it as fast as its velocity from the start."""
        metres: np.ndarray = np.hypot(self.velocities[:, 0], self.velocities[:, 1]) * self.steps * self.free
        return metres


def roll_out(
    parameters: DwaParameters, checker: FootprintChecker, pose: Pose2D, velocity: Twist2D, velocities: np.ndarray,
    period: float, distance_left: float, sim_time: float,
) -> Trajectories:
    """Simulate a batch of velocities and lay the footprint along it.

    A trajectory lasts `sim_time`, or until it has driven `distance_left`: the robot would stop at the goal. Its poses
    are as far apart as asked for, but no farther, where there is room for as many, than that nothing lies between two,
    and where there is no room for as many as asked for, as far as that, in turning as many times as there are seconds:
    base_local_planner's do not grow more with a longer time.

    Args:
        parameters: Limits, granularities, stop_time_buffer and footprint scaling.
        checker: The obstacles.
        pose, velocity: The robot now.
        velocities: Shape (N, 3).
        period: Seconds until the next command.
        distance_left: Metres to the goal.
        sim_time: How far ahead (s) trajectories reach, where stopping does not take longer.
    """
    p, number = parameters, len(velocities)
    accelerations = np.maximum(1e-9, [p.acc_lim_x, p.acc_lim_y, p.acc_lim_theta])
    speeds, stopping, durations = np.empty(number), np.empty(number), np.empty(number)
    asked, enough = (p.sim_granularity, p.angular_sim_granularity), (checker.longest_step, checker.longest_turn)
    coarse = max(asked[0], enough[0]), max(asked[1], enough[1]) * max(1.0, sim_time)
    for apart in ((min(asked[0], enough[0]), min(asked[1], enough[1])), asked, coarse):
        longest = trajectory_kernels.time_spans(
            velocities, accelerations, period + p.stop_time_buffer, sim_time, distance_left, *apart, speeds, stopping,
            durations,
        )
        if number * (longest + 1) <= MOST_POSES:
            break
    require_room(number, longest + 1)
    poses = np.empty((number, math.ceil(longest) + 1, 3))
    counts, steps = np.empty(number, np.int64), np.empty(number)
    start = np.array(velocity, dtype=float) if not p.use_dwa else np.full(3, np.nan)
    trajectory_kernels.simulate(
        np.array(pose, dtype=float), start, accelerations, velocities, durations, *apart, poses, counts, steps,
    )
    way = checker.first_contacts(poses, counts, _scales(p, speeds), pose)
    ends, needed, spare = np.empty((number, 3)), np.empty(number, np.int64), np.empty(number)
    trajectory_kernels.outlook(
        np.array(pose, dtype=float),
        poses,
        counts,
        way.steps,
        steps,
        stopping,
        durations,
        speeds,
        sim_time,
        ends,
        needed,
        spare,
    )
    commands = velocities
    if not p.use_dwa:
        change = accelerations * period
        commands = np.clip(velocities, np.array(velocity) - change, np.array(velocity) + change)
        needed[~_brake_free(p, checker, pose, commands, period)] = NEVER
    return Trajectories(velocities, commands, poses, counts, steps, way.steps, needed, ends, spare,
                        way.highest_costs, way.summed_costs)


def _brake_free(
    parameters: DwaParameters, checker: FootprintChecker, pose: Pose2D, commands: np.ndarray, period: float
) -> np.ndarray:
    """Tell of each command, (N, 3), whether the robot can still stop after it; shape (N,).

    A trajectory that accelerates leads through velocities it has not sampled: that there is room to stop from where it
    is going says nothing of what is commanded now.
    """
    different, which = np.unique(commands, axis=0, return_inverse=True)
    stops = roll_out(parameters.replace(use_dwa=True), checker, pose, STOP, different, period, math.inf, 0.0)
    brakes: np.ndarray = (stops.free >= stops.needed)[which]
    return brakes


def require_room(trajectories: int, poses: float) -> None:
    """Raise ControlError where a batch is more than a machine holds, and name what makes it so."""
    if trajectories * poses > MOST_POSES:
        raise ControlError(
            ControlOutcome.INTERNAL_ERROR,
            f"{trajectories} trajectories of {poses:.0f} poses are more than the {MOST_POSES} that can be looked at: "
            "lower vx_samples, vy_samples, vth_samples, sim_time or stop_time_buffer, or raise sim_granularity, "
            "angular_sim_granularity or the acceleration limits")


def _scales(p: DwaParameters, speeds: np.ndarray) -> np.ndarray:
    """Return the factor on the footprint at each speed: it grows from scaling_speed to max_vel_trans."""
    span = p.max_vel_trans - p.scaling_speed
    if span <= 0.0:
        return np.ones_like(speeds)
    return 1.0 + p.max_scaling_factor * np.clip((speeds - p.scaling_speed) / span, 0.0, 1.0)


def speed_to_stop_within(distance: float, acceleration: float, delay: float) -> float:
    """Return the highest speed (m/s) from which braking that begins after a delay ends within a distance.

    Args:
        distance: In metres; with radians in place of all metres it is for turns.
        acceleration: How fast the robot slows down (m/s^2).
        delay: Until it begins to (s).
    """
    if distance <= 0.0:
        return 0.0
    return acceleration * (math.sqrt(delay * delay + 2.0 * distance / acceleration) - delay)


def reachable(now: float, wanted: float, acceleration: float, period: float) -> Tuple[float, bool]:
    """Return `wanted` limited to what one period of acceleration can make of `now`, and whether it was in reach."""
    change = acceleration * period
    value = min(now + change, max(now - change, wanted))
    return value, value == wanted

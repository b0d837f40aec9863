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

STANDING = 0.05  # share of the top speed below which a robot counts as turning on the spot
NEVER = 1 << 30  # poses needed, of a trajectory that must not be driven: more than any has free
MOST_POSES = 1000000
"""Most poses of a batch: a cycle with as many takes more than half a second."""


@dataclass(frozen=True)
class VelocityWindow:
    """The dynamic window: velocities reachable within a time, body frame.

    Attributes:
        low, high: Lowest and highest of each component.
        still: The reachable velocity nearest to standing: braking as hard as possible. Minimum velocities above zero do
            not apply to it, so that it may lie below `low`.
    """

    low: Twist2D
    high: Twist2D
    still: Twist2D

    @property
    def can_stand(self) -> bool:
        """Whether the robot can stand by then."""
        return all(abs(value) <= 1e-9 for value in self.still)

    def clip(self, velocity: Twist2D) -> Twist2D:
        """Return the nearest velocity of the window, component by component."""
        return Twist2D(*(min(high, max(low, value)) for low, value, high in zip(self.low, velocity, self.high)))

    def clip_all(self, velocities: np.ndarray) -> np.ndarray:
        """Return `clip` of each row of velocities, shape (N, 3), with equal results down to the sign of zeros."""
        raised: np.ndarray = np.where(velocities > self.low, velocities, self.low)
        return np.where(raised < self.high, raised, self.high)


def window_of(
    parameters: FollowerParameters, velocity: Twist2D, horizon: float, speed: float, turn: float
) -> VelocityWindow:
    """Return the velocities reachable from `velocity` within `horizon` seconds and the limits.

    Where the present velocity is so far beyond a limit that this is out of reach, only the hardest braking is left.

    Args:
        parameters: Limits and accelerations.
        velocity: The present velocity, body frame.
        horizon: Time (s) of acceleration.
        speed: Top translational speed (m/s) in this cycle.
        turn: Top rotational speed (rad/s) in this cycle.
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
    """Return a measured velocity limited to what could have been commanded.

    More than that, as of a robot that slips sideways or rolls downhill, cannot be reduced by braking within the
    acceleration limits; and with odometry in a wrong unit, commands and measurements would raise each other.

    Args:
        parameters: Limits.
        velocity: Measured by odometry, body frame.
        last: The last command; it may exceed limits that were lowered since.
    """
    p = parameters
    limits = ((p.min_vel_x, p.max_vel_x), (p.min_vel_y, p.max_vel_y), (-p.max_vel_theta, p.max_vel_theta))
    return Twist2D(*(
        min(max(value, min(low, now, 0.0)), max(high, now, 0.0))
        for value, now, (low, high) in zip(velocity, last, limits)
    ))


def sample(parameters: DwaParameters, window: VelocityWindow, speed: float) -> np.ndarray:
    """Return samples of the window, shape (N, 3): evenly spaced in each component, with its ends and zero.

    Standing still and translational speeds above `speed` (m/s) are left out. Sample counts below 2 count as 2.
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
    """Return whether a velocity's, (3,), translational speed is the highest of the window."""
    fastest = max(abs(window.low.x), abs(window.high.x), abs(window.low.y), abs(window.high.y))
    return bool(np.hypot(velocity[0], velocity[1]) >= fastest - 1e-4)


def too_slow(parameters: DwaParameters, window: VelocityWindow, velocities: np.ndarray) -> np.ndarray:
    """Return of each velocity, (N, 3), whether it is below both min_vel_trans and min_vel_theta, bool of shape (N,).

    Exempt are the fastest of the window (the robot starts, or has to be slow here), those at the top speed of their
    direction, and turns on the spot, whose speed `turn_rate` decides.
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
        commands: Shape (N, 3): the velocity to command for it now, within one period's acceleration.
        poses: Shape (N, S, 3): poses after each step.
        counts: Shape (N,): poses simulated; a trajectory ends where it has driven as far as the goal.
        steps: Shape (N,): time (s) between poses.
        free: Shape (N,): poses before the first contact.
        needed: Shape (N,): poses that must be free for the robot to be able to stop.
        ends: Shape (N, 3): the last free pose, the robot's own where none is free.
        spare: Shape (N,): distance (m) it would drive on within sim_time beyond the goal.
        highest_costs, summed_costs: Shape (N,): costmap costs at the robot's centre, over the free poses.
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
        """Distance (m) to the end of each, shape (N,), at its sampled speed from the start."""
        metres: np.ndarray = np.hypot(self.velocities[:, 0], self.velocities[:, 1]) * self.steps * self.free
        return metres


def roll_out(
    parameters: DwaParameters, checker: FootprintChecker, pose: Pose2D, velocity: Twist2D, velocities: np.ndarray,
    period: float, distance_left: float, sim_time: float,
) -> Trajectories:
    """Simulate a batch of velocities and check the footprint along each trajectory.

    A trajectory lasts `sim_time`, or until it has driven `distance_left`, where the robot would stop at the goal. Of
    three spacings of poses the first is taken that keeps the batch within MOST_POSES: the finer of the parameters'
    granularity and the spacing at which no obstacle fits between two poses; the granularity; the coarser of the two,
    in turns times sim_time, since base_local_planner's trajectories do not have more poses for a longer time.

    Args:
        parameters: Limits, granularities, stop_time_buffer and footprint scaling.
        checker: The obstacles.
        pose, velocity: The robot's present pose (costmap's frame) and velocity (body frame).
        velocities: Shape (N, 3), body frame.
        period: Time (s) until the next command.
        distance_left: Distance (m) to the goal.
        sim_time: Duration (s) of trajectories, where stopping does not take longer.

    Raises:
        ControlError: INTERNAL_ERROR: there would be more than MOST_POSES.
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
    """Return of each command, (N, 3), whether the robot can hold it for a period and stop, bool of shape (N,).

    Needed with use_dwa false: trajectories then accelerate to the sampled velocity, and room to stop at that velocity
    does not mean room to stop after the command that is sent now.
    """
    different, which = np.unique(commands, axis=0, return_inverse=True)
    stops = roll_out(parameters.replace(use_dwa=True), checker, pose, STOP, different, period, math.inf, 0.0)
    brakes: np.ndarray = (stops.free >= stops.needed)[which]
    return brakes


def require_room(trajectories: int, poses: float) -> None:
    """Raise ControlError INTERNAL_ERROR for a batch of more than MOST_POSES poses, naming the parameters to change."""
    if trajectories * poses > MOST_POSES:
        raise ControlError(
            ControlOutcome.INTERNAL_ERROR,
            f"{trajectories} trajectories of {poses:.0f} poses are more than the {MOST_POSES} that can be looked at: "
            "lower vx_samples, vy_samples, vth_samples, sim_time or stop_time_buffer, or raise sim_granularity, "
            "angular_sim_granularity or the acceleration limits")


def _scales(p: DwaParameters, speeds: np.ndarray) -> np.ndarray:
    """Return the factor on the footprint at each speed (m/s), (N,): it grows from scaling_speed to max_vel_trans."""
    span = p.max_vel_trans - p.scaling_speed
    if span <= 0.0:
        return np.ones_like(speeds)
    return 1.0 + p.max_scaling_factor * np.clip((speeds - p.scaling_speed) / span, 0.0, 1.0)


def speed_to_stop_within(distance: float, acceleration: float, delay: float) -> float:
    """Return the highest speed (m/s) from which braking that begins after a delay ends within a distance.

    Args:
        distance: Metres, or for turns radians (and rad/s, rad/s^2).
        acceleration: Deceleration (m/s^2).
        delay: Time (s) until braking begins.
    """
    if distance <= 0.0:
        return 0.0
    return acceleration * (math.sqrt(delay * delay + 2.0 * distance / acceleration) - delay)


def reachable(now: float, wanted: float, acceleration: float, period: float) -> Tuple[float, bool]:
    """Return `wanted` limited to what is reachable from `now` within a period, and whether `wanted` itself is."""
    change = acceleration * period
    value = min(now + change, max(now - change, wanted))
    return value, value == wanted

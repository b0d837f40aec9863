"""Collision checks of commands: the arc of a command held for one period and braked from must be free."""

from __future__ import annotations

import math
from typing import NamedTuple, Tuple

import numpy as np

from mbf_relay.control import trajectory_kernels
from mbf_relay.control.cycle import ControlCycle
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.state import ControlState
from mbf_relay.control.trajectories import MOST_POSES, require_room
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Twist2D

SLOWER = 0.5, 0.25, 0.125
"""Shares of a command tried, fastest first, where a standing robot's command leads over ground it cannot see."""


def braking_time(parameters: FollowerParameters, command: Twist2D, period: float) -> float:
    """Return the time (s) for which the command's constant velocity covers the way of one period and then braking."""
    limits = (parameters.acc_lim_x, parameters.acc_lim_y, parameters.acc_lim_theta)
    return period + max(abs(value) / (2.0 * max(1e-9, limit)) for value, limit in zip(command, limits))


def stopping_time(parameters: FollowerParameters, command: Twist2D, period: float) -> float:
    """Return `braking_time` plus stop_time_buffer (s)."""
    return braking_time(parameters, command, period) + parameters.stop_time_buffer


def arc(checker: FootprintChecker, state: ControlState, command: Twist2D, duration: float) -> np.ndarray:
    """Return the poses along the arc of a constant velocity.

    Args:
        checker: Gives the spacing of the poses: twice its step, as the check is repeated each cycle.
        state: The robot's pose is where the arc begins.
        command: Velocity, body frame.
        duration: Time (s) for which it is held.

    Returns:
        Shape (S, 3), in the costmap's frame.
    """
    poses, counts = _arcs(checker, state, np.array([command], dtype=float), np.array([duration]))
    return poses[0, : counts[0]]


def _arcs(
    checker: FootprintChecker, state: ControlState, commands: np.ndarray, durations: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Return `arc` for commands (N, 3) and durations (N,): poses, shape (N, S, 3), and the number of each, (N,).

    Raises:
        ControlError: INTERNAL_ERROR: even at the largest spacing allowed there would be more than MOST_POSES.
    """
    speeds, turns = np.hypot(commands[:, 0], commands[:, 1]), np.abs(commands[:, 2])
    for step, turn in (2.0 * checker.step, checker.turn_step), (checker.longest_step, checker.longest_turn):
        most = math.ceil(float((np.maximum(speeds / step, turns / turn) * durations).max(initial=0.0))) + 1
        if len(commands) * most <= MOST_POSES:
            break
    require_room(len(commands), most)
    poses, counts = np.empty((len(commands), most, 3)), np.empty(len(commands), np.int64)
    trajectory_kernels.simulate(
        np.array(state.pose, dtype=float), np.full(3, np.nan), np.ones(3), commands, durations, step, turn, poses,
        counts, np.empty(len(commands)),
    )
    return poses, counts


class Arcs(NamedTuple):
    """The arcs of N commands.

    Attributes:
        poses: Shape (N, S, 3), in the costmap's frame.
        counts: Shape (N,): poses of each arc.
        steps: Shape (N,): time (s) between poses, and from now to the first.
    """

    poses: np.ndarray
    counts: np.ndarray
    steps: np.ndarray


def arcs_to_a_stand(
    parameters: FollowerParameters, state: ControlState, checker: FootprintChecker, commands: np.ndarray
) -> Arcs:
    """Return the arcs of commands, (N, 3), held for one period and braked from, with stop_time_buffer."""
    durations = np.array([stopping_time(parameters, Twist2D(*command), state.period) for command in commands.tolist()])
    poses, counts = _arcs(checker, state, commands, durations)
    return Arcs(poses, counts, durations / counts)


def brakes_free(
    parameters: FollowerParameters, state: ControlState, checker: FootprintChecker, command: Twist2D
) -> bool:
    """Return whether the arc of a command, held for one period and braked from, touches no more than is touched now."""
    poses = arc(checker, state, command, stopping_time(parameters, command, state.period))
    return checker.free_steps(poses, state.pose) == len(poses)


def brake_free(state: ControlState, checker: FootprintChecker, arcs: Arcs) -> np.ndarray:
    """Return for each of `arcs_to_a_stand` whether it is free as in `brakes_free`, bool of shape (N,)."""
    ways = checker.first_contacts(arcs.poses, arcs.counts, np.ones(len(arcs.counts)), state.pose)
    free: np.ndarray = ways.steps == arcs.counts
    return free


def braked_on_its_arc(parameters: FollowerParameters, cycle: ControlCycle) -> Twist2D:
    """Return the command that brakes hardest while keeping the curvature of the present motion.

    That arc has been checked. With each component reduced at its own limit the robot would leave it: a differential
    drive that brakes both wheels at once turns as fast as before while its speed falls, and sideways motion may end
    before forward motion.

    Where the arc is not free all the way to the stop, the command is scaled down by the share that is, beyond the
    acceleration limits if need be: those in parameter files are often set for comfort, and braking by 0.05 m/s^2 would
    take the robot into an obstacle that the wheels could have stopped for.

    Args:
        parameters: Limits.
        cycle: Pose, velocity, window and obstacles of this cycle.
    """
    state, still, velocity = cycle.state, cycle.window.still, cycle.velocity
    shares = [left / speed if left * speed > 0.0 else 0.0 for left, speed in zip(still, velocity)]
    share = min(1.0, max(shares[:2]))
    command = Twist2D(*(
        left if own >= share else share * speed for left, speed, own in zip(still, velocity, shares)))
    way = arc(cycle.checker, state, command, braking_time(parameters, command, state.period))
    free = cycle.checker.free_steps(way, state.pose) / len(way)
    return command.scaled(free)


def where_it_sees(parameters: FollowerParameters, cycle: ControlCycle, command: Twist2D) -> Twist2D:
    """Return a command where its braking arc lies in sight of the robot; else one that brakes or creeps.

    What an obstacle hides may, once it is seen, be nearer than the robot can stop. A moving robot then brakes on its
    arc; one that stands takes a slower command, down to the smallest of SLOWER, since standing would not show more.
    A robot that touches something is not checked: what it touches hides the ground beside it.

    Args:
        parameters: Limits.
        cycle: Pose, velocity, window and obstacles of this cycle.
        command: Velocity that is free of known obstacles.
    """
    state, checker = cycle.state, cycle.checker

    def is_seen(tried: Twist2D) -> bool:
        way = arc(checker, state, tried, stopping_time(parameters, tried, state.period))
        return checker.sees_way(state.pose, way)

    if command.speed() == 0.0 or checker.contacts_at(state.pose) or is_seen(command):
        return command
    braked = braked_on_its_arc(parameters, cycle)
    if braked.speed() > 0.0:
        return braked
    slower = [command.scaled(share) for share in SLOWER]
    return next(filter(is_seen, slower), slower[-1])

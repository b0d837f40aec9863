"""Whether a command may be sent: the robot could hold it for a period and brake, and would touch nothing."""

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
"""Shares of a command that are tried where it leads out of sight and the robot stands."""


def braking_time(parameters: FollowerParameters, command: Twist2D, period: float) -> float:
    """Return the time (s) at the command's velocity that leads as far as holding it for a period and braking then."""
    limits = (parameters.acc_lim_x, parameters.acc_lim_y, parameters.acc_lim_theta)
    return period + max(abs(value) / (2.0 * max(1e-9, limit)) for value, limit in zip(command, limits))


def stopping_time(parameters: FollowerParameters, command: Twist2D, period: float) -> float:
    """Return `braking_time` with stop_time_buffer to spare (s)."""
    return braking_time(parameters, command, period) + parameters.stop_time_buffer


def arc(checker: FootprintChecker, state: ControlState, command: Twist2D, duration: float) -> np.ndarray:
    """Return the poses that holding a command leads through.

    Args:
        checker: Tells how far apart poses are to be checked; the command is asked for anew each cycle, so twice that.
        state: Where the robot is.
        command: What it holds.
        duration: For how long (s).

    Returns:
        Shape (S, 3), in the costmap's frame.
    """
    poses, counts = _arcs(checker, state, np.array([command], dtype=float), np.array([duration]))
    return poses[0, : counts[0]]


def _arcs(
    checker: FootprintChecker, state: ControlState, commands: np.ndarray, durations: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Return `arc` for commands (N, 3) and durations (N,): poses, shape (N, S, 3), and how many each has, (N,).

    Raises:
        ControlError: These would be too many, even as far apart as poses may be.
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
    """Where commands lead.

    Attributes:
        poses: Shape (N, S, 3), in the costmap's frame.
        counts: Shape (N,): how many poses each has.
        steps: Shape (N,): seconds from one to the next, and to the first.
    """

    poses: np.ndarray
    counts: np.ndarray
    steps: np.ndarray


def arcs_to_a_stand(
    parameters: FollowerParameters, state: ControlState, checker: FootprintChecker, commands: np.ndarray
) -> Arcs:
    """Return where commands, (N, 3), lead that are held for a period and braked from."""
    durations = np.array([stopping_time(parameters, Twist2D(*command), state.period) for command in commands.tolist()])
    poses, counts = _arcs(checker, state, commands, durations)
    return Arcs(poses, counts, durations / counts)


def brakes_free(
    parameters: FollowerParameters, state: ControlState, checker: FootprintChecker, command: Twist2D
) -> bool:
    """Return whether a command can be held for a period and braked from without touching more than is touched already.
    """
    poses = arc(checker, state, command, stopping_time(parameters, command, state.period))
    return checker.free_steps(poses, state.pose) == len(poses)


def brake_free(state: ControlState, checker: FootprintChecker, arcs: Arcs) -> np.ndarray:
    """Tell of each of many commands by its arc to a stand whether `brakes_free` holds; shape (N,)."""
    ways = checker.first_contacts(arcs.poses, arcs.counts, np.ones(len(arcs.counts)), state.pose)
    free: np.ndarray = ways.steps == arcs.counts
    return free


def braked_on_its_arc(parameters: FollowerParameters, cycle: ControlCycle) -> Twist2D:
    """Return the command that brakes as hard as can be and keeps to the arc the robot is on, which was looked along.

    Told to stand at once, wheels brake each as hard as it can: until the slower one stands the robot turns as fast as
    before, and off the arc to its inner side. One that drives sideways as well would end that first, and go on ahead.

    Where the way to a stand on it is longer than what is free of it, the command is as much slower, whatever the
    accelerations are: those of a file are for comfort as often as they are the wheels' own, and a robot that brakes by
    0.05 m/s^2 because it says so drives for seconds into what it sees.

    Args:
        parameters: Limits.
        cycle: Where the robot is, how fast, and among what.
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
    """Return a command, or to brake on the arc the robot is on where the command's sweeps over what is out of sight.

    What stands behind an obstacle shows when the robot is round it, and may then be nearer than its way to a stand. Of
    one that touches already, what it touches hides the ground beside it. One that stands creeps on until it sees:
    nothing else would end its standing.

    Args:
        parameters: Limits.
        cycle: Where the robot is, how fast, and among what.
        command: Free as far as obstacles are seen.
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

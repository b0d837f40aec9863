"""Evasion: the robot gives way to moving obstacles."""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np

from mbf_relay.control import evasion_kernels
from mbf_relay.control.braking import arcs_to_a_stand, brake_free
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.foresight import BETTER, Foresight
from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.space_time import BLOCKED, PRICE, SpaceTimeCosts
from mbf_relay.control.state import ControlState, SpeedLimit
from mbf_relay.control.trajectories import VelocityWindow, window_of
from mbf_relay.costmap.cost_grid import without_tracks
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import STOP, Twist2D

HEADINGS = 16  # directions of manoeuvres, all round
DISTANCES = (0.6, 2.5, 5.0)  # lengths of manoeuvres, in robot's widths
EFFORT = 0.02  # share of its duration that a manoeuvre costs: of equally good ones the shortest is taken
TURN_WORTH = 0.5  # robot's widths of driving that a radian of turning counts as for that
TOLERANCE = 0.1  # s by which a manoeuvre must be better than the controller's command
FLEES = 0.02  # s of exposure less than standing from which on a manoeuvre counts as fleeing
SHARES = np.linspace(1.0, 0.0, 9)  # blends of the command with braking that are tried; the last one only brakes
LEAST_SPEED = 1e-3  # m/s: lower bound of top speeds in the simulation

def _manoeuvres(width: float, backwards: bool, on_the_spot: bool) -> np.ndarray:
    """Return manoeuvres, shape (N, 3): turn (rad), distance (m), and whether it turns first; row 0 is to stand."""
    headings = (np.arange(HEADINGS) - HEADINGS // 2 + 1) * (2.0 * math.pi / HEADINGS)
    ways = [distance * width * sign for distance in DISTANCES for sign in ((1.0, -1.0) if backwards else (1.0,))]
    firsts = (1.0, 0.0) if on_the_spot else (0.0,)
    rows = [(turn, way, first) for turn in headings for way in ways for first in firsts]
    return np.array([(0.0, 0.0, 1.0), *rows])


class Evasion:
    """Searches evasive manoeuvres: turn to any direction, on the spot or while driving, drive a little, and stand.

    Each is simulated for SpaceTimeCosts.moment, and so is the controller's command, held or stopped. The cost is the
    time in contact with tracks and obstacles, and the cost to go from the place reached. The cheapest manoeuvre is
    begun if it is cheaper than the command; the next cycle decides anew.

    Manoeuvres are left out that begin with a command from which the robot could not brake before a static obstacle or
    could run into somebody (standing still never is), and backward ones where the sensors do not look backwards.
    Nothing is searched while no track comes near any place within reach. Cells marked by tracked obstacles are ignored,
    because these will have moved on.

    Source: Petti, Fraichard, "Safe motion planning in dynamic environments" (2005), for a part of a way at a time;
    Bertsekas, Tsitsiklis, Wu, "Rollout algorithms for combinatorial optimization" (1997), for judging it.
    """

    def __init__(
        self, parameters: FollowerParameters, foresight: Foresight, state: ControlState, limit: SpeedLimit,
        turning_radius: float, path: LocalPath,
    ) -> None:
        """Prepare one cycle.

        Args:
            parameters: The controller's.
            foresight: The predicted tracks.
            state: The state of this cycle.
            limit: Speed limit here; evading may use it where the path is followed more slowly.
            turning_radius: Minimum turning radius (m); 0 for a robot that turns on the spot.
            path: The path to follow.
        """
        self._parameters, self._foresight, self._state, self._pose = parameters, foresight, state, state.pose
        self._checker = FootprintChecker(without_tracks(state.costmap, state.now))
        width = state.costmap.width
        backwards = parameters.min_vel_x < 0.0 and state.costmap.sees_all_round
        self._manoeuvres = _manoeuvres(width, backwards, turning_radius == 0.0)
        self._turning_radius = turning_radius
        speed, self._turn = limit.of(parameters.max_vel_trans, parameters.max_vel_theta)
        self._speed = max(LEAST_SPEED, speed)
        lengths = np.abs(self._manoeuvres[:, 1]) + TURN_WORTH * width * np.abs(self._manoeuvres[:, 0])
        self._efforts = EFFORT * lengths / self._speed
        self._cost_to_go = SpaceTimeCosts(foresight, self._checker, state.pose, path, self._speed)
        self._steps = max(1, math.ceil(self._cost_to_go.moment / state.period - 1e-9))
        self._step = self._cost_to_go.moment / self._steps

    def command(self, velocity: Twist2D, wanted: Twist2D) -> Twist2D:
        """Return the wanted command, the beginning of a manoeuvre, or the best way to stop.

        It stops where the robot could not brake before a contact, and both braking and standing where it is are met no
        sooner. Commands on which it could run into somebody who turns towards it are blended with braking until they
        are safe.

        Args:
            velocity: Present velocity, body frame.
            wanted: The controller's command.
        """
        window = window_of(self._parameters, velocity, self._state.period, self._speed, self._turn)
        command, flees = self._way_out(velocity, wanted, window)
        if command == STOP:
            return command
        still = np.array(window.still)
        held_back = still + SHARES[:, None] * (np.array(command) - still)
        arcs = arcs_to_a_stand(self._parameters, self._state, self._checker, held_back)
        met, duration = self._foresight.meetings(*arcs), arcs.counts[0] * arcs.steps[0]
        instead = min(met[-1], self._foresight.meeting_of_standing(self._pose)) + (-BETTER if flees else BETTER)
        is_late = met[0] <= min(duration, instead)
        runs_into = self._foresight.runs_into(*arcs)
        if is_late or runs_into[:-1].all():
            return STOP if runs_into[-1] else window.still
        return Twist2D(*held_back[int(np.argmin(runs_into))].tolist())

    def _way_out(self, velocity: Twist2D, wanted: Twist2D, window: VelocityWindow) -> Tuple[Twist2D, bool]:
        """Return the command to begin, and whether it flees from a track that will reach the robot where it stands.

        A fleeing robot may have to turn first, which at first is no better than to stand.
        """
        if self._cost_to_go.is_clear:
            return wanted, False
        stopped, _ = self._driven(wanted, self._manoeuvres[:1])
        as_wanted, _ = self._judged(np.concatenate((self._held(wanted), stopped)))
        poses, first = self._driven(velocity, self._manoeuvres)
        costs, exposures = self._judged(poses)
        costs += self._efforts
        begun = window.clip_all(np.insert(first, 1, 0.0, axis=1))
        commands, which = np.unique(begun[1:], axis=0, return_inverse=True)
        arcs = arcs_to_a_stand(self._parameters, self._state, self._checker, commands)
        begins = brake_free(self._state, self._checker, arcs) & ~self._foresight.runs_into(*arcs)
        costs[1:][~begins[which.ravel()]] = np.inf
        best = int(np.argmin(costs))
        if as_wanted.min() <= costs[best] + TOLERANCE:
            return wanted, False
        flees = bool(exposures[best] < exposures[0] - FLEES)
        return Twist2D(*begun[best].tolist()), flees

    def _held(self, wanted: Twist2D) -> np.ndarray:
        """Return the poses of the wanted command held throughout, shape (1, S, 3)."""
        pose, times = self._pose, self._step * np.arange(1, self._steps + 1)
        headings = pose.theta + wanted.theta * (times - 0.5 * self._step)
        x = self._step * np.cumsum(wanted.x * np.cos(headings) - wanted.y * np.sin(headings))
        y = self._step * np.cumsum(wanted.x * np.sin(headings) + wanted.y * np.cos(headings))
        return np.column_stack((pose.x + x, pose.y + y, pose.theta + wanted.theta * times))[None]

    def _driven(self, velocity: Twist2D, manoeuvres: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Return the poses of manoeuvres, shape (N, S, 3), and their first velocities (m/s, rad/s), (N, 2)."""
        p = self._parameters
        poses, first = np.empty((len(manoeuvres), self._steps, 3)), np.empty((len(manoeuvres), 2))
        evasion_kernels.roll_out(
            np.array(self._pose, dtype=float), np.array((velocity.x, velocity.theta)), manoeuvres,
            *(max(LEAST_SPEED, min(self._speed, top)) for top in (p.max_vel_x, -p.min_vel_x)), self._turn,
            self._turning_radius, max(1e-9, p.acc_lim_x), max(1e-9, p.acc_lim_theta), self._step, poses, first,
        )
        return poses, first

    def _judged(self, poses: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Return the cost (s) and the time of contact (s) of each row of poses, (N, S, 3), shapes (N,)."""
        number = len(poses)
        free = self._checker.first_contacts(
            poses, np.full(number, self._steps), np.ones(number), self._pose).steps
        exposures = self._foresight.exposures(poses, self._step)
        hits = np.where(free < self._steps, BLOCKED * (1.0 + (self._steps - free) * self._step), 0.0)
        return PRICE * exposures + hits + self._cost_to_go.at(poses[:, -1]), exposures

"""Evasion: whoever comes along the robot's place is let past."""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np

from mbf_relay.control import evasion_kernels
from mbf_relay.control.braking import arc, stopping_time
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.foresight import BETTER, Foresight
from mbf_relay.control.state import ControlState, SpeedLimit
from mbf_relay.control.trajectories import VelocityWindow, window_of
from mbf_relay.costmap.cost_grid import without_tracks
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import STOP, Twist2D

HEADINGS = 16  # ways out, all round
DISTANCES = (1.2, 2.5, 5.0)  # robot's widths they lead away
ASIDE = 2.5  # robot's widths and a quarter of a turn are far enough aside: the time for both is looked ahead
MARGIN = 0.4  # of the robot's width that is kept from what moves where there is room
TURN_WORTH = 0.5  # robot's widths that a radian of turning counts as where ways out are equally good
MOST_STEPS = 80  # of a manoeuvre: its steps are longer than a period where that would make more


def _manoeuvres(width: float, backwards: bool, on_the_spot: bool) -> np.ndarray:
    """Return what can be tried, shape (N, 3): turn, distance, and whether it turns first; the first one is to stand."""
    headings = (np.arange(HEADINGS) - HEADINGS // 2 + 1) * (2.0 * math.pi / HEADINGS)
    ways = [distance * width * sign for distance in DISTANCES for sign in ((1.0, -1.0) if backwards else (1.0,))]
    firsts = (1.0, 0.0) if on_the_spot else (0.0,)
    rows = [(turn, way, first) for turn in headings for way in ways for first in firsts]
    return np.array([(0.0, 0.0, 1.0), *rows])


class Evasion:
    """Looks for ways out: turn towards any side, on the spot or on the way, drive a little, forward or back, and stand.

    A command is good where the robot is met nowhere if it goes on, or if it stops: it is on its way through, or nobody
    comes. Else it takes the way out on which it is touched last, of those as good the one on which anything comes near
    last, and of those the one with the least to turn and drive. To be touched is judged for as long as stepping aside
    takes, for one may flee before somebody faster for a while; to come near is judged for `foresight_horizon`.

    What moves does not stand in the way where it is marked: it will have gone.

    Source: Fraichard, Asama, "Inevitable collision states: a step towards safer robots?" (2004), for a horizon's
    length; Petti, Fraichard, "Safe motion planning in dynamic environments" (2005), for a set of manoeuvres.
    """

    def __init__(
        self, parameters: FollowerParameters, foresight: Foresight, state: ControlState, limit: SpeedLimit,
        turning_radius: float,
    ) -> None:
        """Get ready for one cycle.

        Args:
            parameters: Of the controller.
            foresight: What moves.
            state: The robot.
            limit: How fast it may go here; it may do so however slowly its path was to be followed.
            turning_radius: Least radius (m) of its curves.
        """
        self._parameters, self._foresight, self._state, self._pose = parameters, foresight, state, state.pose
        self._checker = FootprintChecker(without_tracks(state.costmap, state.now))
        self._allowed = self._checker.contacts_at(state.pose)
        self._width = state.costmap.width
        self._manoeuvres = _manoeuvres(self._width, parameters.min_vel_x < 0.0, turning_radius == 0.0)
        self._turning_radius = turning_radius
        self._efforts = np.abs(self._manoeuvres[:, 1]) + TURN_WORTH * self._width * np.abs(self._manoeuvres[:, 0])
        self._speed = min(limit.share * parameters.max_vel_trans, limit.translation)
        self._turn = min(limit.share * parameters.max_vel_theta, limit.rotation)
        self._horizon = max(parameters.foresight_horizon, self._time_aside())
        self._step = max(state.period, self._horizon / MOST_STEPS)
        self._steps = math.ceil(self._horizon / self._step)

    def _time_aside(self) -> float:
        """Return how long (s) the robot takes to turn to its side and leave, at its top speeds."""
        p, turn = self._parameters, 0.5 * math.pi
        acceleration = max(1e-9, p.acc_lim_theta)
        rate = max(1e-9, min(p.max_vel_theta, math.sqrt(turn * acceleration)))
        return turn / rate + rate / acceleration + ASIDE * self._width / max(1e-9, p.max_vel_trans)

    def command(self, velocity: Twist2D, wanted: Twist2D) -> Twist2D:
        """Return the wanted command or the beginning of a way out, or as good a stop as there is.

        That is where the robot could not brake before it meets what moves, and would be met later where it stands.

        Args:
            velocity: The robot's now.
            wanted: What it would do.
        """
        window = window_of(self._parameters, velocity, self._state.period, self._speed, self._turn)
        command = self._way_out(velocity, wanted, window)
        if command == STOP:
            return command
        duration = stopping_time(self._parameters, command, self._state.period)
        poses = arc(self._checker, self._state, command, duration)
        meeting = self._foresight.meetings(poses[None], np.array([len(poses)]), np.array([duration / len(poses)]))
        cost = self._foresight.costs(meeting, np.array([duration]), self._pose)[0]
        return command if math.isfinite(cost) else window.clip(STOP)

    def _way_out(self, velocity: Twist2D, wanted: Twist2D, window: VelocityWindow) -> Twist2D:
        stopped, _ = self._driven(wanted, self._manoeuvres[:1])
        touched, close = self._meetings(np.concatenate((self._held(wanted), stopped)))
        if ((touched >= self._horizon) & (close >= self._parameters.foresight_horizon)).any():
            return wanted
        poses, first = self._driven(velocity, self._manoeuvres)
        touched_then, close_then = self._meetings(poses)
        latest = touched_then.max() - BETTER
        nearly = close_then[touched_then >= latest].max() - BETTER
        if ((touched >= latest) & (close >= nearly)).any():
            return wanted
        good = np.flatnonzero((touched_then >= latest) & (close_then >= nearly))
        best = good[np.argmin(self._efforts[good])]
        return window.clip(Twist2D(float(first[best, 0]), 0.0, float(first[best, 1])))

    def _held(self, wanted: Twist2D) -> np.ndarray:
        """Return where the wanted command leads if it is held, shape (1, S, 3)."""
        pose, times = self._pose, self._step * np.arange(1, self._steps + 1)
        headings = pose.theta + wanted.theta * (times - 0.5 * self._step)
        x = self._step * np.cumsum(wanted.x * np.cos(headings) - wanted.y * np.sin(headings))
        y = self._step * np.cumsum(wanted.x * np.sin(headings) + wanted.y * np.cos(headings))
        return np.column_stack((pose.x + x, pose.y + y, pose.theta + wanted.theta * times))[None]

    def _driven(self, velocity: Twist2D, manoeuvres: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Return the poses of manoeuvres, shape (N, S, 3), and their first velocities, (N, 2)."""
        p = self._parameters
        poses, first = np.empty((len(manoeuvres), self._steps, 3)), np.empty((len(manoeuvres), 2))
        evasion_kernels.roll_out(
            np.array(self._pose, dtype=float), np.array((velocity.x, velocity.theta)), manoeuvres, self._speed,
            self._turn, self._turning_radius, max(1e-9, p.acc_lim_x), max(1e-9, p.acc_lim_theta), self._step,
            poses, first,
        )
        return poses, first

    def _meetings(self, poses: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Return how late (s) each row of poses is touched, and how late anything comes near or touches, shapes (N,).

        Both end with the horizons they are judged for.
        """
        number, near = len(poses), self._parameters.foresight_horizon
        counts, steps = np.full(number, self._steps), np.full(number, self._step)
        free = self._checker.first_contacts(poses, counts, np.ones(number), self._allowed).steps
        touches = np.where(free < self._steps, free * self._step, math.inf)
        touched = np.minimum(touches, self._foresight.meetings(poses, counts, steps, horizon=self._horizon))
        close = np.minimum(touched, self._foresight.meetings(poses, counts, steps, MARGIN * self._width))
        return np.minimum(self._horizon, touched), np.minimum(near, close)

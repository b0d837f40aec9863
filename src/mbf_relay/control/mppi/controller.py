"""Model predictive path integral control, by the parameters of Nav2's MPPIController."""

from __future__ import annotations

import dataclasses
import math
from typing import List, Optional

import numpy as np

from mbf_relay.control.braking import brakes_free
from mbf_relay.control.checkers import CREEPING
from mbf_relay.control.critics.distances import CUT
from mbf_relay.control.cycle import ControlCycle
from mbf_relay.control.follower import PathFollower
from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.mppi import CRITICS, rollout_kernels
from mbf_relay.control.mppi.critic import POINT_SPACING, CriticFunction, Rollouts
from mbf_relay.control.mppi.parameters import ACKERMANN, MppiParameters
from mbf_relay.control.report import CycleReport
from mbf_relay.costmap.cost_grid import INSCRIBED
from mbf_relay.costmap.footprint_checker import FreeWay
from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.planning.path import Path
from mbf_relay.plugins import create, failures_of

SMOOTHED = np.array([-21.0, 14.0, 39.0, 54.0, 59.0, 54.0, 39.0, 14.0, -21.0]) / 231.0
"""Savitzky-Golay weights of a window of nine for a parabola, with which Nav2 smooths its control sequence, too."""

PAST = 4
"""Past steps of the control sequence that are kept for smoothing."""

STANDING = 1
"""Index of the sample that stands still; where it is the best, the controller fails instead of driving."""

TIGHT = 0.2
"""Share of collisions, among samples with the full noise on turns, above which a place counts as tight. A robot that
stands samples half of its trajectories backwards."""

STRAIGHTEST = 0.05
"""Smallest share of wz_std for samples in a tight place, where every other one gets less noise on turns: between door
jambs a few centimetres away, others collide."""

SLOWER = (1.0, 0.6, 0.3)
"""Shares of a velocity tried, in this order, until one can be braked from without a collision."""


class MppiController(PathFollower):
    """Samples trajectories round the last control sequence, has critics cost them, and drives their weighted mean.

    A mean of free trajectories need not be free. So the command is checked, with braking, as any other controller's;
    where it is not free, that of the best single sample is tried.

    Source: Williams, Drews, Goldfain, Rehg, Theodorou, "Information-theoretic model predictive control" (2018), and
    nav2_mppi_controller, whose parameters it reads.

    Attributes:
        critics: The critics in the order of evaluation.
        costs: Shape (B,): total costs of the last batch.
    """

    Parameters = MppiParameters
    parameters: MppiParameters

    def __init__(self, name: str, parameters: MppiParameters) -> None:
        super().__init__(name, parameters)
        self._prepare()

    def _prepare(self) -> None:
        """Set up everything that depends on the parameters."""
        p = self.parameters
        self.critics: List[CriticFunction] = [
            create(name, name, p.critic_parameters.get(name, {}), CriticFunction, CRITICS) for name in p.critics
        ]
        shape = (p.batch_size, p.time_steps, 3)
        self._deviations = np.array([p.vx_std, p.vy_std, p.wz_std]) * [1.0, float(p.max_vel_y > p.min_vel_y), 1.0]
        self._kept = math.exp(-p.model_dt / p.noise_time) if p.noise_time > 0.0 else 0.0
        self._rng = np.random.default_rng(p.seed)
        self._noises = self._draw()
        half = (p.batch_size + 1) // 2
        turns = np.ones(half, dtype=np.float32)
        turns[1::2] = np.geomspace(1.0, STRAIGHTEST, half // 2)
        self._turns = np.tile(turns, 2)[: p.batch_size]  # shares of wz_std in tight places
        self._is_tight = False
        self._samples, self._velocities, self._poses = (np.empty(shape) for _ in range(3))
        self._sequence = np.zeros((PAST + p.time_steps, 3))
        self.costs = np.zeros(p.batch_size)
        self._horizon = p.max_vel_trans * p.time_steps * p.model_dt  # metres
        self._driven_at: Optional[float] = None

    def _draw(self) -> np.ndarray:
        """Return noise for a batch, shape (B, T, 3), float32, in pairs of opposite sign, so that it is not biased.

        Sample 0 has none, so that the mean itself is judged, too; `_optimize` makes sample STANDING stand still. Along
        a trajectory the noise is a first-order autoregressive process of correlation time noise_time.
        """
        p, kept = self.parameters, self._kept
        noises = self._rng.standard_normal(((p.batch_size + 1) // 2, p.time_steps, 3), dtype=np.float32)
        fresh = math.sqrt(1.0 - kept * kept)
        for step in range(1, p.time_steps if kept > 0.0 else 1):
            noises[:, step] = kept * noises[:, step - 1] + fresh * noises[:, step]
        noises[0] = 0.0
        noises[STANDING] = 0.0
        both = np.concatenate((noises, -noises))[: p.batch_size]
        return np.ascontiguousarray(both * self._deviations.astype(np.float32))

    def reconfigure(self, parameters: MppiParameters) -> None:
        """Take new parameters; the control sequence begins anew, with zeros."""
        super().reconfigure(parameters)
        self._prepare()

    @property
    def lookahead(self) -> float:
        """A fifth of prune_distance, or what a robot at top speed covers in half a second where that is more."""
        return max(self.parameters.prune_distance / 5.0, 0.5 * self.parameters.max_vel_trans)

    @property
    def turn_to_path_angle(self) -> float:
        """The parameter of that name; a car never turns on the spot."""
        return math.inf if self.parameters.motion_model == ACKERMANN else self.parameters.turn_to_path_angle

    @property
    def turning_radius(self) -> float:
        """A car's min_turning_r."""
        return self.parameters.min_turning_r if self.parameters.motion_model == ACKERMANN else 0.0

    def set_path(self, path: Path, is_new_goal: bool) -> None:
        """Follow `path`; see Controller."""
        super().set_path(path, is_new_goal)
        if is_new_goal:
            self._forget()

    @property
    def controls(self) -> np.ndarray:
        """The control sequence: mean velocities of the steps from now on, body frame, shape (T, 3)."""
        return self._sequence[PAST:]

    def _forget(self) -> None:
        self._sequence[:] = 0.0
        self._driven_at = None

    def drive(self, cycle: ControlCycle) -> Twist2D:
        """Return the first velocity of the weighted mean of the samples, if it is free."""
        p = self.parameters
        self._shift(cycle.state.now, cycle.state.period)
        reason = ""
        for _ in range(p.retry_attempt_limit + 1):
            for _ in range(p.iteration_count):
                best = self._optimize(cycle)
            if best == STANDING:
                reason = "no sampled trajectory is better than standing"
                break
            self._smooth()
            if self._puts_off(cycle):
                reason = "the best sampled trajectories begin with standing"
                break
            for controls in (self.controls, self._samples[best]):
                command = self._checked(cycle, controls)
                if command is not None:
                    self._driven_at = cycle.state.now
                    return command
            reason = f"none of {p.batch_size} sampled trajectories can be started and braked from without a collision"
            self._forget()
        self._forget()
        turn = self.turn_to_path(cycle, 0.0) if p.motion_model != ACKERMANN else None
        if turn is not None:
            return turn
        raise self.nothing_left(cycle, reason)

    def _puts_off(self, cycle: ControlCycle) -> bool:
        """Return whether the robot can stand and the control sequence begins with standing.

        Where an obstacle ends the way within the horizon, it costs least to drive there last, and does so again in the
        next cycle: the robot would wait for ever. Near the goal this is not checked, because there costs along the
        trajectory favour driving early; but it is for a car, whose heading may be off with no way left.
        """
        p = self.parameters
        if cycle.path.remaining < cycle.state.costmap.width and p.motion_model != ACKERMANN:
            return False
        first = np.abs(self._first(self.controls, cycle.state.period))
        return cycle.window.can_stand and bool(
            np.hypot(*first[:2]) < CREEPING * p.max_vel_trans and first[2] < CREEPING * p.max_vel_theta)

    def report(self, cycle: ControlCycle, drove: bool) -> CycleReport:
        """Return the report with the trajectory of the best sample."""
        plain = super().report(cycle, drove)
        if not drove or not self.command.speed():
            return plain
        return dataclasses.replace(plain, trajectory=self._poses[int(np.argmin(self.costs))].copy())

    def _turn_at_goal(self, cycle: ControlCycle) -> Twist2D:
        if self.parameters.motion_model == ACKERMANN:  # a car reaches its heading by driving
            self._drove = True
            return self._drive_or_back_out(cycle)
        return super()._turn_at_goal(cycle)

    def _shift(self, now: float, period: float) -> None:
        """Shift the control sequence by the time (s) since the last cycle; reset it if the last command is too old."""
        elapsed = math.inf if self._driven_at is None else now - self._driven_at
        if not 0.0 <= elapsed <= 3.0 * period:
            self._forget()
            return
        steps = np.arange(len(self._sequence))
        for component in range(3):
            self._sequence[:, component] = np.interp(
                steps + elapsed / self.parameters.model_dt, steps, self._sequence[:, component])

    def _smooth(self) -> None:
        """Smooth the control sequence over time, with the last PAST steps driven."""
        last = np.repeat(self._sequence[-1:], PAST, axis=0)
        for component in range(3):
            values = np.concatenate((self._sequence[:, component], last[:, component]))
            self.controls[:, component] = np.convolve(values, SMOOTHED, mode="valid")

    def _optimize(self, cycle: ControlCycle) -> int:
        """Sample a batch, blend it into the control sequence, and return the index of the best sample.

        The noise on turns is adapted to the place, as found by the last batch; Mohamed, Yin, Liu, "Autonomous
        navigation of AGVs in unknown cluttered environments: log-MPPI control strategy" (2022), draw it at random.
        """
        p, checker = self.parameters, cycle.checker
        if p.regenerate_noises:
            self._noises = self._draw()
        low = np.array([max(p.min_vel_x, -cycle.speed), max(p.min_vel_y, -cycle.speed), -cycle.turn])
        high = np.array([min(p.max_vel_x, cycle.speed), min(p.max_vel_y, cycle.speed), cycle.turn])
        radius = self.turning_radius
        noises = self._noises.copy()
        if self._is_tight:
            noises[:, :, 2] *= self._turns[:, None]
        if p.min_vel_x >= 0.0 and p.motion_model != ACKERMANN:
            # it cannot come back: with the full noise nearly all samples would overshoot the goal, and it would stand
            left = max(cycle.path.remaining, cycle.state.pose.distance_to(cycle.path.goal))
            noises[:, :, 0] *= min(1.0, left / (p.vx_std * p.time_steps * p.model_dt))
        noises[STANDING] = -self.controls
        rollout_kernels.roll_out(
            np.array(cycle.state.pose, dtype=float), np.array(cycle.velocity, dtype=float), self.controls, noises,
            low, high, self._limits(), radius, p.model_dt, self._samples, self._velocities, self._poses,
        )
        counts = np.full(p.batch_size, p.time_steps)
        way = checker.first_contacts(self._poses, counts, np.ones(p.batch_size), cycle.state.pose)
        self._is_tight = bool((way.steps < counts)[self._turns == 1.0].mean() > TIGHT)
        data = self._data(cycle, way)
        costs = np.zeros(p.batch_size)
        for critic in self.critics:
            with failures_of(critic, "critic"):
                costs += critic.cost(data)
        self.costs = np.where(np.isfinite(costs), costs, 1e12)
        scales = np.where(self._deviations > 0.0, self._deviations, 1.0)
        gamma = p.gamma * (1.0 - self._kept) / (1.0 + self._kept)  # correlated steps count as fewer
        rollout_kernels.blend(self.costs, self._samples, scales, p.temperature, gamma, low, high, self.controls)
        return int(np.argmin(self.costs))

    def _data(self, cycle: ControlCycle, way: FreeWay) -> Rollouts:
        path, grid = cycle.path, cycle.state.costmap.grid
        p, length = self.parameters, max(POINT_SPACING, min(self.parameters.prune_distance, path.remaining))
        arcs = path.robot_arc + np.linspace(0.0, length, max(2, int(length / POINT_SPACING) + 1))
        points = np.column_stack([np.interp(arcs, path.arcs, path.points[:, axis]) for axis in (0, 1)])
        cells = grid.cells_at(points)
        inside = grid.contains_cells(cells)
        columns, rows = np.where(inside[:, None], cells, 0).T
        is_free = ~inside | (cycle.state.costmap.costs[rows, columns] < INSCRIBED)
        ahead, aside = self._velocities[:, :, 0], self._velocities[:, :, 1]
        speeds = np.hypot(ahead, aside) if aside.any() else np.abs(ahead)  # equal and ten times as fast
        halfway, ends = (self._along(path, speeds[:, :steps], length) for steps in (p.time_steps // 2, p.time_steps))
        furthest = max(0, min(len(points) - 1, int(ends[:, 1].max() / POINT_SPACING + 0.5)))
        return Rollouts(
            p, cycle.state.pose, path.goal, max(path.remaining, cycle.state.pose.distance_to(path.goal)),
            self._velocities, self._poses, way, cycle.checker, points, is_free, halfway, ends, furthest,
        )

    def _along(self, path: LocalPath, speeds: np.ndarray, length: float) -> np.ndarray:
        """Return distance from and progress along the path (m) of each sample after so many steps, shape (B, 2).

        Progress is limited to `length` (m), and to the way driven times CUT: what is near beyond that is another leg.

        Args:
            path: The part of the path near the robot.
            speeds: Shape (B, steps): speed (m/s) in each step.
            length: How far ahead (m) to look.
        """
        most = path.robot_arc + min(length, self._horizon)
        places = path.project(self._poses[:, speeds.shape[1] - 1, :2], path.robot_arc, most)
        driven = speeds.sum(axis=1) * self.parameters.model_dt
        places[:, 1] = np.minimum(places[:, 1] - path.robot_arc, CUT * driven)
        return places

    def _checked(self, cycle: ControlCycle, controls: np.ndarray) -> Optional[Twist2D]:
        """Return the command for a control sequence (T, 3), slowed down until it can be braked from; None if it cannot.
        """
        p = self.parameters
        wanted = self._first(controls, cycle.state.period)
        for share in SLOWER:
            command = self._drivable(cycle, share * wanted)
            if command != STOP and brakes_free(p, cycle.state, cycle.checker, command):
                return command
        return None

    def _first(self, controls: np.ndarray, period: float) -> np.ndarray:
        """Return the mean, shape (3,), of the controls of the next period (s), within a car's turning circle."""
        count = min(len(controls), max(1, round(period / self.parameters.model_dt)))
        mean: np.ndarray = controls[:count].mean(axis=0)
        return np.array(self._steered(Twist2D(*mean.tolist())))

    def _drivable(self, cycle: ControlCycle, wanted: np.ndarray) -> Twist2D:
        return self._steered(cycle.window.clip(Twist2D(*map(float, wanted))))

    def _steered(self, velocity: Twist2D) -> Twist2D:
        """Return the velocity; that of a car with its rotation limited by its turning circle."""
        if self.parameters.motion_model != ACKERMANN:
            return velocity
        most = abs(velocity.x) / self.parameters.min_turning_r
        return Twist2D(velocity.x, 0.0, min(most, max(-most, velocity.theta)))

    def _limits(self) -> np.ndarray:
        return np.array([self.parameters.acc_lim_x, self.parameters.acc_lim_y, self.parameters.acc_lim_theta])

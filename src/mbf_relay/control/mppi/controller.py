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
"""Savitzky and Golay's weights of nine values in a row, for a parabola through them; Nav2 smooths its mean so, too."""

PAST = 4
"""Steps before now that the smoothing looks at."""

STANDING = 1
"""The number of the drive that is no drive: what is no better than that is not worth beginning."""

TIGHT = 0.2
"""Share of the drives that turn as much as in the open which touch something where a place is tight; of a robot that
stands, half begin backwards."""

STRAIGHTEST = 0.05
"""Least share of wz_std by which half of the drives turn in such a place: between jambs a few centimetres off, others
touch."""

SLOWER = (1.0, 0.6, 0.3)
"""Shares of a velocity tried where braking from all of it would touch something."""


class MppiController(PathFollower):
    """Imagines a batch of drives round the mean of the cycle before, has critics cost them, and drives their mean.

    The mean of free drives need not be free: what is commanded is checked, with braking, like any other controller's
    command, and the best single drive takes its place where it is not.

    Source: Williams, Drews, Goldfain, Rehg, Theodorou, "Information-theoretic model predictive control" (2018), and
    nav2_mppi_controller, whose parameters it reads.

    Attributes:
        critics: In the order they are asked.
        costs: Shape (B,): of the trajectories sampled last.
    """

    Parameters = MppiParameters
    parameters: MppiParameters

    def __init__(self, name: str, parameters: MppiParameters) -> None:
        super().__init__(name, parameters)
        self._prepare()

    def _prepare(self) -> None:
        """Make what depends on the parameters."""
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
        """Return noise for a batch, float32: each drive's is there with either sign, so that it leans to neither side.

        The first drive has none, so that the mean itself is among those judged; another one will stand still.
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
        """Take new parameters; the drive begun goes on from a standing robot's mean."""
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
        """The mean of the velocities to command, step by step from now on, shape (T, 3)."""
        return self._sequence[PAST:]

    def _forget(self) -> None:
        self._sequence[:] = 0.0
        self._driven_at = None

    def drive(self, cycle: ControlCycle) -> Twist2D:
        """Return the first velocity of the mean of all drives, weighted by their worth."""
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
        """Return whether the robot stands, and the mean begins with standing on.

        Where the way ends within the horizon before an obstacle, it costs least to go there last; in the next cycle
        that is true again. Near the goal the drives are charged for their whole way there, and one creeps up to it; a
        car whose heading is off has no way left, and creeps nowhere.
        """
        p = self.parameters
        if cycle.path.remaining < cycle.state.costmap.width and p.motion_model != ACKERMANN:
            return False
        first = np.abs(self._first(self.controls, cycle.state.period))
        return cycle.window.can_stand and bool(
            np.hypot(*first[:2]) < CREEPING * p.max_vel_trans and first[2] < CREEPING * p.max_vel_theta)

    def report(self, cycle: ControlCycle, drove: bool) -> CycleReport:
        """Return where the best drive leads."""
        plain = super().report(cycle, drove)
        if not drove or not self.command.speed():
            return plain
        return dataclasses.replace(plain, trajectory=self._poses[int(np.argmin(self.costs))].copy())

    def _turn_at_goal(self, cycle: ControlCycle) -> Twist2D:
        if self.parameters.motion_model == ACKERMANN:  # which gets its heading by driving
            self._drove = True
            return self._drive_or_back_out(cycle)
        return super()._turn_at_goal(cycle)

    def _shift(self, now: float, period: float) -> None:
        """Move the mean on by the time since it was made; start anew where the robot did something else meanwhile."""
        elapsed = math.inf if self._driven_at is None else now - self._driven_at
        if not 0.0 <= elapsed <= 3.0 * period:
            self._forget()
            return
        steps = np.arange(len(self._sequence))
        for component in range(3):
            self._sequence[:, component] = np.interp(
                steps + elapsed / self.parameters.model_dt, steps, self._sequence[:, component])

    def _smooth(self) -> None:
        """Take the unrest out of the mean, the present in the light of the past."""
        last = np.repeat(self._sequence[-1:], PAST, axis=0)
        for component in range(3):
            values = np.concatenate((self._sequence[:, component], last[:, component]))
            self.controls[:, component] = np.convolve(values, SMOOTHED, mode="valid")

    def _optimize(self, cycle: ControlCycle) -> int:
        """Imagine a batch, blend it into the mean, and return the number of the best drive.

        How much drives are to turn is a matter of the place, and the last batch told of that; Mohamed, Yin, Liu,
        "Autonomous navigation of AGVs in unknown cluttered environments: log-MPPI control strategy" (2022), draw it.
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
            # past its goal it cannot come back: sampled as far as ever, nearly all trajectories end there and it stands
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
        gamma = p.gamma * (1.0 - self._kept) / (1.0 + self._kept)  # steps that are alike tell one thing, not many
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
        speeds = np.hypot(ahead, aside) if aside.any() else np.abs(ahead)  # the same, in a tenth of the time
        halfway, ends = (self._along(path, speeds[:, :steps], length) for steps in (p.time_steps // 2, p.time_steps))
        furthest = min(len(points) - 1, int(ends[:, 1].max() / POINT_SPACING + 0.5))
        return Rollouts(
            p, cycle.state.pose, path.goal, max(path.remaining, cycle.state.pose.distance_to(path.goal)),
            self._velocities, self._poses, way, cycle.checker, points, is_free, halfway, ends, furthest,
        )

    def _along(self, path: LocalPath, speeds: np.ndarray, length: float) -> np.ndarray:
        """Return where each drive has come to on the path after so many steps: metres across and along it, (B, 2).

        None gets farther than it drives and cuts corners, for what is near beyond that is another leg; nor than
        `length` (m).

        Args:
            path: Ahead.
            speeds: Shape (B, steps): of each step (m/s).
            length: How far ahead (m) to look.
        """
        most = path.robot_arc + min(length, self._horizon)
        places = path.project(self._poses[:, speeds.shape[1] - 1, :2], path.robot_arc, most)
        driven = speeds.sum(axis=1) * self.parameters.model_dt
        places[:, 1] = np.minimum(places[:, 1] - path.robot_arc, CUT * driven)
        return places

    def _checked(self, cycle: ControlCycle, controls: np.ndarray) -> Optional[Twist2D]:
        """Return the velocity that controls lead to within a period, or a slower one that can be braked from.

        Else None.
        """
        p = self.parameters
        wanted = self._first(controls, cycle.state.period)
        for share in SLOWER:
            command = self._drivable(cycle, share * wanted)
            if command != STOP and brakes_free(p, cycle.state, cycle.checker, command):
                return command
        return None

    def _first(self, controls: np.ndarray, period: float) -> np.ndarray:
        """Return the mean, shape (3,), of the controls of the next period (s); a car that stands does not turn."""
        count = min(len(controls), max(1, round(period / self.parameters.model_dt)))
        mean: np.ndarray = controls[:count].mean(axis=0)
        return np.array(self._steered(Twist2D(*mean.tolist())))

    def _drivable(self, cycle: ControlCycle, wanted: np.ndarray) -> Twist2D:
        return self._steered(cycle.window.clip(Twist2D(*map(float, wanted))))

    def _steered(self, velocity: Twist2D) -> Twist2D:
        """Return the velocity, of a car with the tightest turn it can steer at that speed at most."""
        if self.parameters.motion_model != ACKERMANN:
            return velocity
        most = abs(velocity.x) / self.parameters.min_turning_r
        return Twist2D(velocity.x, 0.0, min(most, max(-most, velocity.theta)))

    def _limits(self) -> np.ndarray:
        return np.array([self.parameters.acc_lim_x, self.parameters.acc_lim_y, self.parameters.acc_lim_theta])

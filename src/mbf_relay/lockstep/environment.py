"""A gymnasium environment for learning to navigate: observations, actions and rewards.

    import gymnasium

    environment = gymnasium.make("mbf_relay.lockstep.environment:mbf_relay/Navigation-v0", worlds="barn")
    observation, info = environment.reset(seed=1)

The policy takes the place of planner and controller: it observes the scan and the goal, and commands velocities.
World, lidar, wheels and contacts are simulated as in batches, so that one seed and one sequence of actions give one
episode, bit by bit. Only this module needs gymnasium, and nothing else imports it.
"""

from __future__ import annotations

import functools
import math
import operator
import sys
import warnings
from pathlib import Path
from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, Union

import gymnasium
import numpy as np
from gymnasium import spaces

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.lockstep.driver import path_of_processes
from mbf_relay.lockstep.environment_parameters import EnvironmentParameters
from mbf_relay.lockstep.settings import config_folder, full_name, parse_change
from mbf_relay.lockstep.setup import ODOMETRY, TRUTH, faults_in, known_names, make_setup
from mbf_relay.lockstep.tasks import EpisodeTask, load_tasks, task_of, warnings_of
from mbf_relay.scan import LaserScan
from mbf_relay.simulation import Simulation
from mbf_relay.simulation.drive import Odometry
from mbf_relay.simulation.generators import KINDS, generate
from mbf_relay.simulation.observations import Observations
from mbf_relay.simulation.parameters import SimulationParameters, steps_between
from mbf_relay.simulation.robot import OMNIDIRECTIONAL
from mbf_relay.simulation.robot_file import load_robot
from mbf_relay.simulation.worlds_file import world_of

ID = "mbf_relay/Navigation-v0"
"""The environment's id in gymnasium's registry."""
FARTHEST = 1000.0
"""Metres to which the goal's coordinates are clipped in observations."""
Observed = Dict[str, np.ndarray]
"""An observation; see NavigationEnvironment."""


class NavigationEnvironment(gymnasium.Env):
    """Drive to the goal without touching anything.

    An observation holds, as float32:

    - `scan`: the nearest reading (m) of each sector, the first one ahead, counter-clockwise; the lidar's range_max
      where a sector has none;
    - `goal`: x, y (m) in the robot's frame;
    - `velocity`: x, y (m/s) and yaw (rad/s) by odometry.

    An action is a velocity as fractions of the robot's top velocity, each from -1 to 1 and clipped to that: x and yaw,
    or x, y and yaw for an omnidirectional robot. An episode terminates at the last goal or at a contact, and is
    truncated at the world's time limit.

    Attributes:
        parameters: See EnvironmentParameters.
        top_velocity: The velocity of an action of ones, shape (A,), m/s and rad/s.
    """

    metadata: Dict[str, Any] = {"render_modes": []}

    def __init__(
        self, worlds: str = "barn", seeds: Sequence[int] = (0, 100000), robot: str = "", localization: str = TRUTH,
        changes: Union[str, Iterable[str]] = (), **parameters: Any,
    ) -> None:
        """Read worlds and parameters; the world itself is built by `reset`.

        Args:
            worlds: A kind of `make_worlds.py` (a new world for each episode), the path of a worlds file (one of its
                worlds for each episode), or "circle".
            seeds: First seed of generated worlds, and one past the last, so that others can be kept for testing.
            robot: The robot, as for `batch.py --robot`; the one of the simulator's parameters where empty.
            localization: Source of the pose by which the goal is observed: "truth", or "odometry" from the true start.
            changes: One change "simulator.scan_noise=0" of the simulator's parameters, or several.
            parameters: Values of EnvironmentParameters.

        Raises:
            ValueError: A file, a name or a value is wrong; the text says which. There is a Python warning for entries
                that are unknown or have no effect.
        """
        for name in EnvironmentParameters.unknown_names(parameters):
            hint = EnvironmentParameters.hint(name)
            raise ValueError(f"the environment has no parameter '{name}'{hint}")
        if localization not in (TRUTH, ODOMETRY):
            raise ValueError(f"localization is '{localization}'; it must be '{TRUTH}' or '{ODOMETRY}'")
        self.parameters = EnvironmentParameters.from_mapping(parameters)
        changes = [changes] if isinstance(changes, str) else list(changes)
        setup = make_setup(config_folder(), localization, changes=changes, robot=robot, has_map=False)
        settings = setup.settings
        for text in changes:
            node = full_name(parse_change(text)[0], known_names(settings)).partition(".")[0]
            if node != "simulator":
                raise ValueError(f"changes are of {node}, which takes no part here; only the simulator's are used")
        self._simulator = SimulationParameters.from_mapping(settings["simulator"]).replace(
            imu_rate=0.0, joint_state_rate=0.0, cmd_vel_timeout=0.0  # an action holds until the next one
        )
        if not self._simulator.scan_rate or not self._simulator.odom_rate:
            raise ValueError("the simulator's scan_rate or odom_rate is 0 Hz; the environment needs lidar and odometry")
        self._faults = faults_in(settings)
        self._steps = steps_between("control_rate", self.parameters.control_rate, self._simulator.physics_rate)
        self._worlds = _Worlds(worlds, seeds)
        for note in [*setup.notes, *warnings_of(self._worlds.tasks)]:
            warnings.warn(note, stacklevel=2)
        self._follows_truth = localization == TRUTH
        self._simulation: Optional[Simulation] = None
        self._distance = 0.0
        self._robot = load_robot(self._simulator.robot)
        self._make_spaces()

    def _make_spaces(self) -> None:
        limits, robot = self._simulator, self._robot
        speed, turn = limits.max_speed, limits.max_turn_rate
        self.top_velocity = np.array([speed, speed, turn] if robot.drive == OMNIDIRECTIONAL else [speed, turn])
        self.action_space = spaces.Box(-1.0, 1.0, self.top_velocity.shape)
        moving = np.array([2.0 * speed, 2.0 * speed, 2.0 * turn], np.float32)  # measured speeds may exceed the limits
        sight = np.full(self.parameters.beams, limits.scan_range_max, np.float32)
        place = np.full(2, FARTHEST, np.float32)
        self.observation_space = spaces.Dict({
            "scan": spaces.Box(np.zeros_like(sight), sight), "goal": spaces.Box(-place, place),
            "velocity": spaces.Box(-moving, moving),
        })
        directions = robot.scan_in_base.flat().theta + limits.beam_directions
        sectors = np.round(directions / (2.0 * math.pi / self.parameters.beams)).astype(int)
        self._sectors = sectors % self.parameters.beams

    def reset(
        self, *, seed: Optional[int] = None, options: Optional[Dict[str, Any]] = None
    ) -> Tuple[Observed, Dict[str, Any]]:
        """Begin an episode; return its first observation and the info dictionary.

        Args:
            seed: Seed of this episode and those after it; where None the generator goes on.
            options: {"world": name} chooses one of a file, {"world_seed": number} a generated one.

        Raises:
            ValueError: There is no such world, or the robot cannot stand at its start.
        """
        super().reset(seed=seed)
        self.close()
        self._task = self._worlds.choose(self.np_random, options or {})
        chance = int(self.np_random.integers(2**31))
        self._simulation = Simulation(self._task.world, self._simulator, chance, robot=self._robot)
        self._began = self._simulation.now
        self._reached = 0
        self._scan: Optional[LaserScan] = None
        self._odometry: Optional[Odometry] = None
        while self._scan is None or self._odometry is None:
            self._take(self._simulation.step())
        self._simulation.faults = self._faults  # not before: a lidar that is silent by a fault has no first scan
        self._distance = self._distance_to_goal()
        return self._observed(), self._info(False)

    def step(self, action: Any) -> Tuple[Observed, float, bool, bool, Dict[str, Any]]:
        """Drive at a velocity for one control period; return observation, reward, terminated, truncated and info.

        Raises:
            ValueError: The velocity is not finite, or has another shape than the action space.
        """
        simulation = self._require_simulation()
        wanted = np.asarray(action, dtype=float)
        if wanted.shape != self.action_space.shape:
            raise ValueError(f"an action has shape {wanted.shape}; it must be {self.action_space.shape}")
        x, *aside, yaw = (np.clip(wanted, -1.0, 1.0) * self.top_velocity).tolist()
        simulation.set_command(Twist2D(x, aside[0] if aside else 0.0, yaw))
        left, touched = self._steps, False
        while left and not touched:
            steps, observations = simulation.advance(left)
            self._take(observations)
            left, touched = left - steps, bool(observations.contacts)
        reward, success = self._reward(touched)
        late = simulation.now - self._began > self._task.time_limit
        return self._observed(), reward, touched or success, late and not (touched or success), self._info(success)

    def close(self) -> None:
        """Free the physics engine."""
        if self._simulation is not None:
            self._simulation.close()
            self._simulation = None

    def _reward(self, touched: bool) -> Tuple[float, bool]:
        """Return a step's reward, and whether the last goal is reached; where one is, go on to the next."""
        parameters = self.parameters
        before, self._distance = self._distance, self._distance_to_goal()
        earned = parameters.reward_progress * (before - self._distance)
        earned += parameters.reward_time / parameters.control_rate
        if touched:
            return earned + parameters.reward_contact, False
        radius = self._task.goal_radius or parameters.goal_radius
        if self._distance > radius:
            return earned, False
        self._reached += 1
        success = self._reached == len(self._task.goals)
        if not success:
            self._distance = self._distance_to_goal()
        return earned + parameters.reward_goal, success

    def _goal(self) -> Pose2D:
        return self._task.goals[min(self._reached, len(self._task.goals) - 1)]

    def _distance_to_goal(self) -> float:
        """Return the true distance (m) to the goal, by which rewards are given, whatever `localization` is."""
        return self._require_simulation().true_pose.distance_to(self._goal())

    def _take(self, observations: Observations) -> None:
        self._scan = observations.scan or self._scan
        self._odometry = observations.odometry or self._odometry

    def _observed(self) -> Observed:
        simulation, scan, odometry = self._require_simulation(), self._scan, self._odometry
        assert scan is not None and odometry is not None
        believed = simulation.true_pose if self._follows_truth else self._task.world.start.compose(odometry.pose)
        place = np.array(self._goal().relative_to(believed)[:2])
        nearest = np.full(self.parameters.beams, scan.range_max)
        hit = scan.hit
        np.minimum.at(nearest, self._sectors[hit], scan.ranges[hit])
        parts = {"scan": nearest, "goal": place, "velocity": np.array(odometry.velocity)}
        return {name: np.clip(value.astype(np.float32), self.observation_space[name].low,
                              self.observation_space[name].high) for name, value in parts.items()}

    def _info(self, success: bool) -> Dict[str, Any]:
        simulation = self._require_simulation()
        return {
            "world": self._task.name, "time": simulation.now - self._began, "distance": self._distance,
            "goals_reached": self._reached, "success": success,
        }

    def _require_simulation(self) -> Simulation:
        if self._simulation is None:
            raise ValueError("the environment has no episode; call reset() first")
        return self._simulation


class _Worlds:
    """The worlds of the episodes; arguments as for NavigationEnvironment.

    Attributes:
        tasks: Those of a file; empty where worlds are generated.
    """

    def __init__(self, source: str, seeds: Sequence[int]) -> None:
        self._kind = source if source in KINDS else None
        try:
            self._first, self._end = map(operator.index, seeds)
        except (TypeError, ValueError):  # one number, three, or none at all
            self._first = self._end = 0
        if not 0 <= self._first < self._end:
            raise ValueError(f"seeds are {seeds}; they must be two: a first whole one, 0 or more, and one above it")
        self.tasks: List[EpisodeTask] = [] if self._kind else load_tasks(source)

    def choose(self, chance: np.random.Generator, options: Mapping[str, Any]) -> EpisodeTask:
        """Return the task that `options` choose, else a random one.

        Raises:
            ValueError: There is no such world, or an option is not for this kind of worlds.
        """
        known = "world_seed" if self._kind else "world"
        strange = sorted(map(str, set(options) - {known}))
        if strange:
            worlds = "worlds that are generated" if self._kind else "the worlds of a file"
            raise ValueError(f"reset() knows no option '{strange[0]}' of {worlds}; one is chosen by '{known}'")
        if self._kind:
            seed = options.get("world_seed", int(chance.integers(self._first, self._end)))
            return _generated(self._kind, int(seed))
        index = int(chance.integers(len(self.tasks)))
        name = options.get("world", self.tasks[index].name)
        found = [task for task in self.tasks if task.name == name]
        if not found:
            raise ValueError(f"there is no world '{name}'; there are {', '.join(t.name for t in self.tasks)}")
        return found[0]


@functools.lru_cache(maxsize=256)
def _generated(kind: str, seed: int) -> EpisodeTask:
    return task_of(world_of(Path("generated worlds"), 0, generate(kind, seed)))


def vectorised(count: int, **arguments: Any) -> Any:
    """Return gymnasium's AsyncVectorEnv of `count` environments, each in a process of its own.

    Args:
        count: Number of environments; fastest with one per core.
        arguments: Arguments of NavigationEnvironment.
    """
    made = functools.partial(NavigationEnvironment, **arguments)
    here, sys.path = sys.path, path_of_processes()  # multiprocessing passes sys.path to its processes
    try:
        return gymnasium.vector.AsyncVectorEnv([made] * count, context="spawn")
    finally:
        sys.path = here


if ID not in gymnasium.registry:
    gymnasium.register(ID, entry_point=f"{__name__}:NavigationEnvironment")

"""TrajectoryPlannerROS: its own words, said in those of the controller that drives."""

import functools
import math

import numpy as np
import pytest
from kinematics import PaperRobot, boxes, costmap_round, discs, drive, path_through

from mbf_relay.control import CONTROLLERS
from mbf_relay.control.braking import brakes_free
from mbf_relay.control.controller import Controller
from mbf_relay.control.state import ControlState
from mbf_relay.control.trajectory_planner import as_dwa
from mbf_relay.control.trajectory_planner_parameters import DYNAMIC, TrajectoryPlannerParameters
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D
from mbf_relay.outcomes import ControlError
from mbf_relay.plugins import PluginError, create

NAME = "base_local_planner/TrajectoryPlannerROS"
ROBOT = dict(
    acc_lim_x=1.0, acc_lim_theta=2.0, max_vel_x=0.5, min_vel_x=0.1, max_vel_theta=1.5, min_vel_theta=-1.5,
    min_in_place_vel_theta=0.3, holonomic_robot=False, meter_scoring=True,
)
UPSTREAM = {
    "acc_lim_x": (2.5, 0, 20),
    "acc_lim_y": (2.5, 0, 20),
    "acc_lim_theta": (3.2, 0, 20),
    "max_vel_x": (0.55, 0, 20),
    "min_vel_x": (0.0, 0, 20),
    "max_vel_theta": (1.0, 0, 20),
    "min_vel_theta": (-1.0, -20, 0),
    "min_in_place_vel_theta": (0.4, 0, 20),
    "sim_time": (1.7, 0, 10),
    "sim_granularity": (0.025, 0, 5),
    "angular_sim_granularity": (0.025, 0, math.pi / 2),
    "path_distance_bias": (0.6, 0, 5),
    "goal_distance_bias": (0.8, 0, 5),
    "occdist_scale": (0.01, 0, 5),
    "oscillation_reset_dist": (0.05, 0, 5),
    "escape_reset_dist": (0.1, 0, 5),
    "escape_reset_theta": (math.pi / 2, 0, 5),
    "vx_samples": (20, 1, 300),
    "vtheta_samples": (20, 1, 300),
    "heading_lookahead": (0.325, 0, 5),
    "holonomic_robot": (True, None, None),
    "escape_vel": (-0.1, -2, 2),
    "dwa": (False, None, None),
    "heading_scoring": (False, None, None),
    "heading_scoring_timestep": (0.1, 0, 1),
    "simple_attractor": (False, None, None),
    "y_vels": ("-0.3,-0.1,0.1,-0.3", None, None),
}
"""Name, default and range of what base_local_planner's BaseLocalPlanner.cfg (ROS Noetic) declares."""


def made(**changes):
    return create("TrajectoryPlannerROS", NAME, {**ROBOT, **changes}, Controller, CONTROLLERS)


def test_names_defaults_and_ranges_for_dynamic_reconfigure_are_upstreams():
    assert sorted(DYNAMIC) == sorted(UPSTREAM)
    fields = TrajectoryPlannerParameters.__dataclass_fields__
    for name, (default, lowest, highest) in UPSTREAM.items():
        meta = fields[name].metadata
        lower = meta["above"] if meta["minimum"] is None else meta["minimum"]
        assert (fields[name].default, lower, meta["maximum"]) == (default, lowest, highest), name


def test_a_robot_that_never_said_it_drives_sideways_is_not_driven_sideways():
    values = {key: value for key, value in ROBOT.items() if key != "holonomic_robot"}
    controller = create("T", NAME, values, Controller, CONTROLLERS)
    assert controller.parameters.holonomic_robot is False
    assert any("holonomic_robot" in note for note in controller.notes)


def test_a_robot_that_scores_in_metres_shuns_obstacles_no_more_than_one_that_scores_in_cells():
    metres = as_dwa(TrajectoryPlannerParameters(**ROBOT), 0.025)
    cells = as_dwa(TrajectoryPlannerParameters(**{**ROBOT, "meter_scoring": False}), 0.025)
    for weight in ("path_distance_bias", "goal_distance_bias", "occdist_scale"):
        assert getattr(cells, weight) == pytest.approx(40.0 * getattr(metres, weight)), weight


@pytest.mark.parametrize("name, value", [("pdist_scale", 0.75), ("acc_lim_th", 1.25), ("max_rotational_vel", 0.7)])
def test_older_names_are_read(name, value):
    present = TrajectoryPlannerParameters.deprecated_names({name: value})[name]
    assert getattr(TrajectoryPlannerParameters.from_mapping({name: value}), present) == value


@pytest.mark.parametrize("dwa", [True, False])
@pytest.mark.parametrize("heading_scoring", [True, False])
def test_it_drives_round_a_bend_within_the_file_s_limits(dwa, heading_scoring):
    path = path_through((0, 0), (1.0, 0), (1.0, 1.0))
    robot = PaperRobot(Pose2D(0.0, 0.0, 0.0))
    controller = made(dwa=dwa, heading_scoring=heading_scoring, heading_scoring_timestep=0.8)
    ended = drive(controller, path, Pose2D(0.0, 0.0, 0.0), boxes((0.3, 0.6, 0.6, 1.0)), seconds=40.0, robot=robot)
    commands = np.array(ended.commands)
    assert ended.reached and not ended.contacts, ended.error
    assert 0.4 < commands[:, 0].max() <= 0.5 + 1e-9 and np.abs(commands[:, 2]).max() <= 1.5 + 1e-9
    assert not commands[:, 1].any() and commands[:, 0].min() >= -0.1 - 1e-9


def test_a_robot_that_drives_sideways_does():
    controller = made(holonomic_robot=True, y_vels="-0.3, 0.3", acc_lim_y=1.0)
    path = path_through((0, 0), (1.5, 0.0))
    robot = PaperRobot(Pose2D(0.0, 0.25, 0.0))
    ended = drive(controller, path, robot.pose, seconds=30.0, robot=robot)
    commands = np.array(ended.commands)
    assert ended.reached and np.abs(commands[:, 1]).max() > 0.05 and np.abs(commands[:, 1]).max() <= 0.3 + 1e-9


@pytest.mark.parametrize("dwa", [False, True])
@pytest.mark.parametrize("x, y, theta", [(1.56, 0.1, 3.1), (1.6, -0.12, -2.6), (1.58, 0.07, 1.6)])
def test_a_robot_that_drives_sideways_comes_back_to_a_goal_it_has_overshot(dwa, x, y, theta):
    controller = made(holonomic_robot=True, y_vels="-0.3, -0.1, 0.1, 0.3", acc_lim_y=2.5, acc_lim_x=2.5, dwa=dwa)
    robot = PaperRobot(Pose2D(x, y, theta))
    ended = drive(controller, path_through((0, 0), (1.5, 0.0)), robot.pose, seconds=12.0, robot=robot)
    assert ended.reached, ended.error


@pytest.mark.parametrize("listed, told", [([-0.3, -0.1, 0.1, -0.3], "-0.3,-0.1,0.1,-0.3"), ([], ""), (0.25, "0.25")])
def test_velocities_sideways_that_are_a_list_leave_no_robot_without_a_controller(listed, told):
    controller = made(holonomic_robot=True, y_vels=listed, acc_lim_y=1.0)
    assert controller.parameters.y_vels == told
    assert controller.parameters.sideways() == {"": 0.0, "0.25": 0.25}.get(told, 0.3)
    assert [note for note in controller.notes if "y_vels" in note] == [
        f"parameter y_vels is {listed!r} and no text: '{told}' is used"]


def test_velocities_sideways_that_are_no_numbers_are_named():
    with pytest.raises(PluginError, match="y_vels.*fast"):
        made(holonomic_robot=True, y_vels="0.1, fast")


def test_sideways_drift_of_a_robot_that_cannot_brake_it_is_no_reason_to_stop():
    """Skid-steered odometry shows some; with acc_lim_y 0 it used to fill the memory with poses."""
    controller = made(acc_lim_y=0.0, dwa=True)
    controller.set_path(path_through((0, 0), (1.5, 0)), True)
    drifting = STOP._replace(x=0.2, y=0.03)
    command = controller.compute_velocity(
        ControlState(0.0, Pose2D(0.0, 0.0, 0.0), drifting, costmap_round(Pose2D(0.0, 0.0, 0.0)), IDENTITY, 0.1))
    assert command.x > 0.1 and command.y == 0.0


@pytest.mark.parametrize("dwa", [False, True])
def test_a_heavy_robot_that_turns_at_speed_is_told_nothing_it_could_not_stop_from(dwa):
    """Its brakes need three seconds: that it could stop from the velocity it slows down to says nothing of now."""
    limits = dict(acc_lim_x=0.35, acc_lim_theta=0.8, max_vel_x=1.0, sim_time=1.0, vx_samples=3, vtheta_samples=10)
    driven = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        controller, turn, pose = made(dwa=dwa, **limits), float(rng.uniform(-1.2, 1.2)), Pose2D(0.0, 0.0, 0.0)
        posts = discs(*((*rng.uniform((0.6, -1.5), (2.0, 1.5)), 0.1) for _ in range(3)))
        controller.set_path(path_through((0.0, 0.0), (1.0, 0.4 * turn), (1.5, 1.5 * turn)), True)
        velocity = Twist2D(1.0, 0.0, turn)
        state = ControlState(0.0, pose, velocity, costmap_round(pose, posts, size=6.0), IDENTITY, 0.1)
        try:
            command = controller.compute_velocity(state)
        except ControlError:
            continue  # and stands as soon as it can
        slower = velocity.x - limits["acc_lim_x"] * state.period
        if command.x <= slower + 1e-9 and command.theta == pytest.approx(turn * command.x / velocity.x):
            continue  # with nothing left, it brakes along its curve as hard as the way left asks for
        driven += 1
        assert brakes_free(as_dwa(controller.parameters, 0.05), state, FootprintChecker(state.costmap), command), seed
    assert driven > 20


def test_a_robot_whose_costmap_ends_a_few_hand_s_breadths_ahead_drives_on():
    """Where its costmap of half a metre ended it reckoned with an obstacle, and crept to a stand before that."""
    controller = made(
        acc_lim_x=0.05, acc_lim_theta=1.0, max_vel_x=0.085, min_vel_x=0.02, max_vel_theta=0.7, min_vel_theta=-0.7,
        min_in_place_vel_theta=0.6, sim_time=4.0, vx_samples=50, vtheta_samples=20, path_distance_bias=3.0,
        goal_distance_bias=0.5, heading_lookahead=0.1, sim_granularity=0.01, dwa=False, yaw_goal_tolerance=3.14)
    square = 0.11 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    small = functools.partial(costmap_round, size=0.5, resolution=0.1, footprint=square)
    path = path_through((0.0, 0.0), (1.5, 0.03))
    driven = drive(controller, path, Pose2D(0.0, 0.0, 0.0), seconds=40.0, costmap=small, patience=3.0)
    assert driven.reached, driven.error


def test_a_robot_that_is_to_look_six_seconds_ahead_fifty_ways_drives():
    """It was told that so many poses cannot be looked at, and stood; in turning C++ looks at no more for a longer time.
    """
    controller = made(
        acc_lim_x=0.5, acc_lim_theta=0.5, max_vel_theta=3.0, min_vel_x=0.0, min_vel_theta=0.1,
        min_in_place_vel_theta=0.2, sim_time=6.0, vx_samples=50, vtheta_samples=50, meter_scoring=True)
    square = 0.6 * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    driven = drive(
        controller, path_through((0.0, 0.0), (1.0, 0.0)), Pose2D(0.0, 0.0, 0.0), seconds=20.0, patience=3.0,
        costmap=functools.partial(costmap_round, size=6.0, resolution=0.05, footprint=square))
    assert driven.reached, driven.error


@pytest.mark.parametrize("changes, named", [
    (dict(max_vel_x=0.0, min_vel_x=0.0, acc_lim_x=0.0), "acc_lim_x"),
    (dict(max_vel_theta=0.0, acc_lim_theta=0.0), "acc_lim_theta"),
    (dict(holonomic_robot=True, acc_lim_y=1e-5), "acc_lim_y")], ids=["back", "to the right", "sideways"])
def test_a_change_that_leaves_a_speed_without_acceleration_is_refused_at_once(changes, named):
    """It was accepted and taken up in the next control cycle, which failed, and no other instance could be made."""
    with pytest.raises(ValueError, match=f"{named} is .*, so the robot could never"):
        made().parameters.reconfigured(changes)

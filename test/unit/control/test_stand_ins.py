"""Stand-ins drive another package's robot: its speeds, its tolerances, and a line that says who drives."""

import math

import numpy as np
import pytest
import upstream_parameters
from kinematics import PaperRobot, drive, path_through

from mbf_relay.control import CONTROLLERS
from mbf_relay.control.controller import Controller
from mbf_relay.geometry import Pose2D
from mbf_relay.plugins import PluginError, create

TEB, MPC, EBAND, FOLLOWER = (
    "teb_local_planner/TebLocalPlannerROS",
    "mpc_local_planner/MpcLocalPlannerROS",
    "eband_local_planner/EBandPlannerROS",
    "pose_follower/PoseFollower",
)
CASES = [
    (
        TEB,
        dict(
            max_vel_x=0.8,
            max_vel_x_backwards=0.2,
            max_vel_theta=1.0,
            acc_lim_x=1.5,
            acc_lim_y=0.0,
            acc_lim_theta=2.0,
            xy_goal_tolerance=0.03,
            yaw_goal_tolerance=0.08,
            weight_obstacle=50.0,
        ),
        0.8,
        1.0,
        0.03,
    ),
    (TEB, dict(max_vel_x=0.3), 0.3, 0.3, 0.2),
    (
        MPC,
        dict(
            robot=dict(
                type="unicycle",
                unicycle=dict(max_vel_x=0.5, max_vel_theta=0.9, acc_lim_x=1.0, dec_lim_x=1.0, acc_lim_theta=0),
                simple_car=dict(max_vel_x=5.0),
            ),
            controller=dict(xy_goal_tolerance=0.05, yaw_goal_tolerance=0.1, publish_ocp_results=True),
            grid=dict(grid_size_ref=20),
        ),
        0.5,
        0.9,
        0.05,
    ),
    (MPC, {}, 0.4, 0.3, 0.2),
    (
        EBAND,
        dict(max_vel_lin=0.75, max_vel_th=1.0, min_vel_lin=0.1, xy_goal_tolerance=0.1, costmap_weight=10),
        0.75,
        1.0,
        0.1,
    ),
    (FOLLOWER, dict(max_vel_lin=0.4, max_vel_th=0.8, tolerance_trans=0.06, k_trans=2.0), 0.4, 0.8, 0.06),
]


@pytest.mark.parametrize("type_name, values, speed, turn, tolerance", CASES)
def test_limits_and_tolerances_are_the_file_s(type_name, values, speed, turn, tolerance):
    controller = create("planner", type_name, values, Controller, CONTROLLERS)
    assert controller.parameters.unknown_names(values) == [], "one line says that the rest has no counterpart"
    assert len(controller.notes) == 1 and type_name in controller.notes[0] and "dynamic window" in controller.notes[0]
    path, robot = path_through((0, 0), (1.5, 0), end_heading=1.5), PaperRobot(Pose2D(0.0, 0.0, -2.0))
    ended = drive(controller, path, robot.pose, seconds=60.0, robot=robot)
    commands = np.array(ended.commands)
    assert ended.reached, ended.error
    assert robot.pose.distance_to(path.goal) <= tolerance
    assert 0.5 * speed < commands[:, 0].max() <= speed + 1e-9 and np.abs(commands[:, 2]).max() <= turn + 1e-9


def test_a_robot_that_drives_sideways_does():
    values = dict(max_vel_x=0.5, max_vel_y=0.4, acc_lim_x=1.0, acc_lim_y=1.0)
    controller = create("planner", TEB, values, Controller, CONTROLLERS)
    path, robot = path_through((0, 0), (1.5, 0)), PaperRobot(Pose2D(0.0, 0.25, 0.0))
    ended = drive(controller, path, robot.pose, seconds=30.0, robot=robot)
    assert ended.reached and np.abs(np.array(ended.commands)[:, 1]).max() > 0.05


@pytest.mark.parametrize("sideways", [dict(acc_lim_y=0.0), {}])
def test_a_robot_of_dwb_that_is_not_said_to_drive_sideways_does_not(sideways):
    """DWB's default of 0.1 m/s sideways could never be reached: its file was refused, or its wheels stood."""
    controller = create(
        "planner", "dwb_local_planner/DWBLocalPlanner", dict(max_vel_x=0.3, **sideways), Controller, CONTROLLERS)
    ended = drive(controller, path_through((0, 0), (1.5, 0)), Pose2D(0.0, 0.25, 0.0), seconds=30.0)
    assert ended.reached, ended.error
    assert not np.array(ended.commands)[:, 1].any()


def test_a_car_is_driven_round_nothing_smaller_than_its_circle():
    values = dict(max_vel_x=0.5, max_vel_theta=1.0, min_turning_radius=0.6, xy_goal_tolerance=0.2)
    controller = create("planner", TEB, values, Controller, CONTROLLERS)
    path, robot = path_through((0, 0), (1.0, 0), (2.2, 0.8)), PaperRobot(Pose2D(0.0, 0.0, 0.0))
    ended = drive(controller, path, robot.pose, seconds=30.0, robot=robot)
    commands = np.array(ended.commands)
    assert ended.reached, ended.error
    assert (np.abs(commands[:, 2]) * 0.6 <= np.abs(commands[:, 0]) + 0.02).all()


def test_a_car_drives_as_fast_as_its_file_says():
    """A car of 1.5 m/s never drove faster than 0.55 m/s, the limit of move_base's tutorials' robots."""
    values = dict(
        max_vel_x=1.5, max_vel_x_backwards=1.0, max_vel_theta=1.0, acc_lim_x=1.0, acc_lim_theta=1.0,
        min_turning_radius=1.0)
    controller = create("planner", TEB, values, Controller, CONTROLLERS)
    ended = drive(controller, path_through((0, 0), (6, 0)), Pose2D(0.0, 0.0, 0.0), seconds=30.0)
    assert ended.reached, ended.error
    assert 1.2 < np.array(ended.commands)[:, 0].max() <= 1.5 + 1e-9 and controller.top_speeds[0] == 1.5


def test_a_car_that_is_told_never_to_change_its_turn_steers_as_others_do():
    """A file's 0 was taken for 0.01 rad/s^2: it swung a metre off a path it could have driven, and was given up."""
    values = dict(
        max_vel_x=0.06, max_vel_x_backwards=0.06, acc_lim_x=0.0, acc_lim_theta=0.0, max_vel_theta=0.5,
        min_turning_radius=0.5)
    controller = create("planner", TEB, values, Controller, CONTROLLERS)
    told = [note for note in controller.notes if "must be above 0" in note]
    assert [("acc_lim_x" in note, "0.5 is used" in note) for note in told] == [(True, True), (False, True)]
    path, robot = path_through((0, 0), (0.8, 0.2), (1.0, 0.6)), PaperRobot(Pose2D(0.0, 0.0, 0.0))
    ended = drive(controller, path, robot.pose, seconds=60.0, robot=robot)
    assert ended.reached, ended.error


def test_a_car_of_mpc_local_planner_takes_its_steering_angle():
    car = dict(wheelbase=0.4, max_vel_x=0.5, max_vel_x_backwards=0.2, max_steering_angle=0.6, acc_lim_x=0.5)
    values = dict(robot=dict(type="simple_car", simple_car=car), controller=dict(xy_goal_tolerance=0.2))
    controller = create("planner", MPC, values, Controller, CONTROLLERS)
    radius = 0.4 / math.tan(0.6)
    assert controller.steering.wheelbase == 0.4 and controller.steering.least_radius == pytest.approx(radius)
    path, robot = path_through((0, 0), (1.0, 0), (2.2, 0.8)), PaperRobot(Pose2D(0.0, 0.0, 0.0))
    ended = drive(controller, path, robot.pose, seconds=30.0, robot=robot)
    commands = np.array(ended.commands)
    assert ended.reached, ended.error
    assert (np.abs(commands[:, 2]) * radius <= np.abs(commands[:, 0]) + 0.02).all()
    bicycle = dict(length_rear=0.1, length_front=0.3, max_steering_angle=0.6)
    values = dict(robot=dict(type="kinematic_bicycle_vel_input", kinematic_bicycle_vel_input=bicycle))
    assert create("planner", MPC, values, Controller, CONTROLLERS).steering.wheelbase == pytest.approx(0.4)


def test_a_car_of_mpc_local_planner_steers_calmly_on_a_straight_path():
    """Its drives were sampled with turns of 30 rad/s: the steering swung from side to side."""
    car = dict(wheelbase=0.4, max_vel_x=0.5, max_vel_x_backwards=0.2, max_steering_angle=0.6, acc_lim_x=0.5)
    controller = create("planner", MPC, dict(robot=dict(type="simple_car", simple_car=car)), Controller, CONTROLLERS)
    ended = drive(controller, path_through((0, 0), (3, 0)), Pose2D(0.0, 0.0, 0.0), seconds=30.0)
    assert ended.reached, ended.error
    assert np.abs(np.diff(np.array(ended.commands)[:, 2])).sum() < 1.0


@pytest.mark.parametrize("robot, said", [
    (dict(type="tricycle"), "robot/type is 'tricycle'; it must be unicycle, simple_car or kinematic_bicycle_vel_input"),
    (dict(type="simple_car", simple_car=dict(max_steering_angle=0.0)), "0 rad at most cannot be steered"),
    (dict(type="simple_car", simple_car=dict(wheelbase="long")), "wheelbase is 'long'"),
    (dict(type="simple_car", simple_car=5), "robot/simple_car is 5; it must be a group"),
    ([], r"robot is \[\]; it must be a group"),
])
def test_what_mpc_local_planner_cannot_drive_is_refused(robot, said):
    with pytest.raises(PluginError, match=said):
        create("planner", MPC, dict(robot=robot), Controller, CONTROLLERS)


def test_a_program_that_slows_a_robot_down_by_teb_s_parameters_is_heard():
    """It waited for a server of dynamic_reconfigure that was not there, and the robot went on at full speed."""
    offered = upstream_parameters.offered("TebLocalPlanner")
    values = dict(max_vel_x=0.5, max_vel_theta=1.0, acc_lim_x=1.0, acc_lim_theta=2.0, max_vel_x_backwards=0.1)
    assert set(values) < set(offered) and offered["max_vel_x"][1] == 0.4
    controller = create("TebLocalPlannerROS", TEB, values, Controller, CONTROLLERS)
    controller.reconfigure(controller.parameters.reconfigured({"max_vel_x": 0.2, "max_vel_theta": 0.6})[0])
    assert controller.dynamic_config and controller.top_speeds == (0.2, 0.6)
    assert not create("MpcLocalPlannerROS", MPC, {}, Controller, CONTROLLERS).dynamic_config, "it has other parameters"


def test_a_program_that_slows_a_robot_down_by_eband_s_parameters_is_heard():
    """As with TEB's: it waited for ever."""
    offered = upstream_parameters.offered("EBandPlanner")
    assert offered["max_vel_lin"][1] == 0.75 and offered["yaw_goal_tolerance"][1] == 0.05
    controller = create("EBandPlannerROS", EBAND, dict(max_vel_lin=0.5), Controller, CONTROLLERS)
    controller.reconfigure(controller.parameters.reconfigured({"max_vel_lin": 0.05, "max_vel_th": 0.6})[0])
    assert controller.dynamic_config and controller.top_speeds == (0.05, 0.6), "also below the lowest speed"
    with pytest.raises(ValueError, match="could never reach or leave 100"):
        controller.parameters.reconfigured({"max_vel_lin": 100.0, "max_translational_acceleration": 0.001})
    assert not create("PoseFollower", FOLLOWER, {}, Controller, CONTROLLERS).dynamic_config, "it has other names"


@pytest.mark.parametrize("robot", [{}, dict(min_turning_radius=0.5)], ids=["turns on the spot", "car"])
@pytest.mark.parametrize("changes", [dict(acc_lim_x=1e-4), dict(acc_lim_theta=1e-4)], ids=["along x", "turning"])
def test_a_change_of_teb_s_limits_that_nothing_can_drive_is_refused_at_once(robot, changes):
    """It was accepted and taken up in the next control cycle, which failed, and no other instance could be made."""
    parameters = create("TebLocalPlannerROS", TEB, robot, Controller, CONTROLLERS).parameters
    with pytest.raises(ValueError, match=f"{next(iter(changes))} is 0.0001, so the robot could never"):
        parameters.reconfigured(changes)

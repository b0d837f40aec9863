"""A car that takes a steering angle drives the arc that was looked along, and not one as wide as chance has it."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from mbf_relay.control import CONTROLLERS
from mbf_relay.control.controller import Controller
from mbf_relay.control.steering import Steering
from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.navigation.navigator import Navigator
from mbf_relay.plugins import PluginError, create

TEB = "teb_local_planner/TebLocalPlannerROS"
CAR = dict(max_vel_x=0.5, max_vel_theta=1.0, min_turning_radius=0.6, wheelbase=0.4, cmd_angle_instead_rotvel=True)


@pytest.mark.parametrize("speed", [0.02, 0.5, -0.3])
@pytest.mark.parametrize("radius", [0.6, -0.6, 2.5])
@pytest.mark.parametrize("wheelbase", [0.4, -0.4])
def test_the_front_wheels_stand_across_the_arc_however_slow_the_car(speed, radius, wheelbase):
    told = Steering(wheelbase, 0.6).steered(Twist2D(speed, 0.0, speed / radius))
    assert told.x == speed
    front, turn_centre = np.array([wheelbase, 0.0]), np.array([0.0, radius])
    wheel = np.array([math.cos(told.theta), math.sin(told.theta)])
    assert wheel @ (front - turn_centre) == pytest.approx(0.0, abs=1e-9)  # it rolls at right angles to its radius


def test_a_car_that_stands_holds_its_wheels_straight_and_none_is_asked_for_less_than_its_circle():
    steering = Steering(0.4, 0.6)
    assert steering.steered(Twist2D(0.0, 0.0, 1.0)) == STOP
    assert steering.steered(Twist2D(0.1, 0.0, 3.0)) == steering.steered(Twist2D(0.1, 0.0, 0.1 / 0.6))
    assert steering.steered(Twist2D(0.1, 0.0, -3.0)).theta == pytest.approx(-math.atan(0.4 / 0.6))


def test_what_is_told_with_an_angle_is_understood_as_the_velocity_it_was():
    rng, steering = np.random.default_rng(3), Steering(0.27)
    for speed, rate in rng.uniform(-1.0, 1.0, (200, 2)):
        velocity = Twist2D(speed, 0.0, rate)
        assert steering.turning(steering.steered(velocity)) == pytest.approx(velocity)


@pytest.mark.parametrize("angle", [math.inf, -math.inf, math.nan])
def test_an_angle_that_is_no_number_comes_to_no_velocity(angle):
    """An infinite one ended the guard of a car: it has no tangent."""
    assert not Steering(0.27).turning(Twist2D(0.1, 0.0, angle)).is_finite()


def test_a_car_by_its_planner_s_file_takes_angles_where_the_file_says_so():
    assert create("planner", TEB, CAR, Controller, CONTROLLERS).steering == Steering(0.4, 0.6)
    assert create("planner", TEB, {**CAR, "cmd_angle_instead_rotvel": False}, Controller, CONTROLLERS).steering is None
    with pytest.raises(PluginError, match="wheelbase is 0"):
        create("planner", TEB, {**CAR, "wheelbase": 0.0}, Controller, CONTROLLERS)


def test_recoveries_steer_the_car_by_angles_too():
    """What a car takes is its own, whoever moves it: its controllers' files say so, and the robot is told."""
    config = {"controllers": [{"name": "TebLocalPlannerROS", "type": TEB}], "TebLocalPlannerROS": CAR}
    robot = SimpleNamespace(steering=None)
    Navigator(config, robot, {})
    assert robot.steering == Steering(0.4, 0.6)

"""Properties that hold whatever the scene: limits, accelerations, and space to stop."""

import math
import os
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "contract"))
from controllers import NAMES, make  # noqa: E402
from kinematics import BURGER, PaperRobot, costmap_round, discs, path_through, touches  # noqa: E402

from mbf_relay.control.state import ControlState  # noqa: E402
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D  # noqa: E402
from mbf_relay.outcomes import ControlError  # noqa: E402

QUICK = settings(max_examples=12, suppress_health_check=[HealthCheck.too_slow])


def scattered(seed, count=25, free=0.3):
    """Return random posts, none near the start."""
    rng = np.random.default_rng(seed)
    posts = [tuple(rng.uniform(-1.5, 1.5, 2)) + (0.04,) for _ in range(count)]
    return discs(*[post for post in posts if math.hypot(post[0], post[1]) > free])


def brake(robot, occupied, acceleration=2.5, turn_acceleration=3.2):
    """Stop as hard as the limits allow, after 0.1 s without a command, and return the contacts on the way."""
    contacts, command = 0, robot.velocity
    for _ in range(200):
        command = Twist2D(*(
            math.copysign(max(0.0, abs(value) - limit * 0.02), value)
            for value, limit in zip(command, (acceleration, acceleration, turn_acceleration))
        ))
        robot.move(command, 0.02)
        contacts += touches(robot.pose, occupied, BURGER, shrink=0.018)
        if command == STOP:
            return contacts
    raise AssertionError("it never stopped")


@pytest.mark.parametrize("name", NAMES)
@QUICK
@given(seed=st.integers(0, 10_000), heading=st.floats(-3.1, 3.1))
def test_from_every_command_the_robot_can_stop_before_what_is_known(name, seed, heading):
    """The footprint may graze a quarter of a cell; what is 18 mm inside of it must stay free."""
    occupied, controller = scattered(seed), make(name)
    controller.set_path(path_through((0, 0), (1.4 * math.cos(heading), 1.4 * math.sin(heading))), True)
    robot = PaperRobot(Pose2D(0.0, 0.0, 0.0), acceleration=2.5, turn_acceleration=20.0)
    for cycle in range(45):
        state = ControlState(
            cycle * 0.1, robot.pose, robot.velocity, costmap_round(robot.pose, occupied), IDENTITY, 0.1
        )
        try:
            command = controller.compute_velocity(state)
        except ControlError:
            command = STOP
        robot.move(command, 0.1)
        assert not touches(robot.pose, occupied, BURGER, shrink=0.018)
    assert brake(robot, occupied) == 0


@pytest.mark.parametrize("name", NAMES)
@QUICK
@given(
    seed=st.integers(0, 10_000), x=st.floats(-0.5, 0.5), theta=st.floats(-6.0, 6.0), speed=st.floats(-0.3, 0.3),
    turn=st.floats(-3.0, 3.0), period=st.sampled_from([0.02, 0.05, 0.1, 0.2]),
)
def test_no_command_leaves_limits_or_accelerations(name, seed, x, theta, speed, turn, period):
    controller, velocity = make(name), Twist2D(speed, 0.0, turn)
    controller.set_path(path_through((0, 0), (0.7, 0.3), (1.2, -0.4)), True)
    state = ControlState(
        0.0, Pose2D(x, 0.1, theta), velocity, costmap_round(Pose2D(x, 0.1, theta), scattered(seed)), IDENTITY, period,
        commanded=velocity,  # faster than it may: its limits were lowered
    )
    try:
        command = controller.compute_velocity(state)
    except ControlError as error:
        assert str(error)
        return
    assert command.is_finite() and command.y == 0.0
    assert abs(command.x - speed) <= 2.5 * period + 1e-9 and abs(command.theta - turn) <= 3.2 * period + 1e-9
    assert abs(command.x) <= max(0.22, abs(speed) - 2.5 * period) + 1e-9
    assert abs(command.theta) <= max(2.75, abs(turn) - 3.2 * period) + 1e-9


@pytest.mark.parametrize("name", NAMES)
@QUICK
@given(seed=st.integers(0, 10_000), theta=st.floats(-3.1, 3.1))
def test_equal_states_give_equal_commands(name, seed, theta):
    answers = []
    for _ in range(2):
        controller = make(name)
        controller.set_path(path_through((0, 0), (1.0, 0.5)), True)
        pose = Pose2D(0.05, 0.0, theta)
        try:
            answers.append(controller.compute_velocity(
                ControlState(0.0, pose, Twist2D(0.1, 0.0, 0.2), costmap_round(pose, scattered(seed)), IDENTITY, 0.1)))
        except ControlError as error:
            answers.append(str(error))
    assert answers[0] == answers[1]

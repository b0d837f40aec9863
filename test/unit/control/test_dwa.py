"""What is the DWA controller's own: parameters by their old names, explanations, critics by name, what it shows."""

import functools
import math
import os
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from kinematics import TURTLEBOT3, PaperRobot, boxes, costmap_round, discs, drive, nowhere, path_through
from paper import burger

from mbf_relay.control import CONTROLLERS
from mbf_relay.control.controller import Controller
from mbf_relay.control.critics import CRITICS
from mbf_relay.control.critics.critic import Critic
from mbf_relay.control.dwa import DwaController
from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.control.explanation import Explanation
from mbf_relay.control.state import ControlState
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D
from mbf_relay.outcomes import ControlError
from mbf_relay.plugins import PluginError, PluginFailure, create, find_class

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

NOETIC = dict(
    max_vel_trans=0.55,
    min_vel_trans=0.1,
    max_vel_x=0.55,
    min_vel_x=0.0,
    max_vel_y=0.1,
    min_vel_y=-0.1,
    max_vel_theta=1.0,
    min_vel_theta=0.4,
    acc_lim_x=2.5,
    acc_lim_y=2.5,
    acc_lim_theta=3.2,
    acc_lim_trans=0.1,
    prune_plan=False,
    xy_goal_tolerance=0.1,
    yaw_goal_tolerance=0.1,
    trans_stopped_vel=0.1,
    theta_stopped_vel=0.1,
    sim_time=1.7,
    sim_granularity=0.025,
    angular_sim_granularity=0.1,
    path_distance_bias=0.6,
    goal_distance_bias=0.8,
    occdist_scale=0.01,
    twirling_scale=0.0,
    stop_time_buffer=0.2,
    oscillation_reset_dist=0.05,
    oscillation_reset_angle=0.2,
    forward_point_distance=0.325,
    scaling_speed=0.25,
    max_scaling_factor=0.2,
    vx_samples=3,
    vy_samples=10,
    vth_samples=20,
    use_dwa=True,
    latch_xy_goal_tolerance=False,
    sum_scores=False,
    cheat_factor=1.0,
    publish_cost_grid_pc=False,
    publish_traj_pc=False,
)


class Shy(Critic):
    """A user's own critic: rules out every turn to the left."""

    @property
    def scale(self):
        return 1.0

    def score(self, trajectories, data):
        return np.where(trajectories.velocities[:, 2] > 1e-9, np.inf, 0.0)


OWN = {name: type(f"Own{name}", (find_class(name, Critic, CRITICS),), {"__module__": __name__}) for name in CRITICS}
"""The built-in critics under a user's names: subclasses with empty bodies."""
globals().update({made.__name__: made for made in OWN.values()})


def critic(name):
    return find_class(name, Critic, CRITICS)(name, burger())


def state(pose=Pose2D(0.0, 0.0, 0.0), velocity=STOP, occupied=nowhere, now=0.0):
    return ControlState(now, pose, velocity, costmap_round(pose, occupied), IDENTITY, 0.1)


def on_the_way(**changes):
    controller = DwaController("DWAPlannerROS", burger(**changes))
    controller.set_path(path_through((0, 0), (1.0, 0.4)), True)
    return controller


def test_names_and_defaults_are_those_of_dwa_local_planner():
    declared = DwaParameters().as_dict()
    assert {name: declared[name] for name in NOETIC} == NOETIC


@pytest.mark.parametrize("old, new", [
    ("max_trans_vel", "max_vel_trans"), ("min_trans_vel", "min_vel_trans"), ("max_rot_vel", "max_vel_theta"),
    ("min_rot_vel", "min_vel_theta"), ("acc_limit_trans", "acc_lim_trans"), ("rot_stopped_vel", "theta_stopped_vel"),
    ("acc_lim_th", "acc_lim_theta"),
])
def test_older_names_are_read_and_told(old, new):
    assert getattr(DwaParameters.from_mapping({old: 0.45}), new) == 0.45
    assert getattr(DwaParameters.from_mapping({old: 0.45, new: 0.5}), new) == 0.5
    assert DwaParameters.deprecated_names({old: 0.45}) == {old: new}


def test_the_tutorials_file_is_taken_whole():
    assert not DwaParameters.unknown_names(TURTLEBOT3)
    controller = create("DWAPlannerROS", "dwa_local_planner/DWAPlannerROS", TURTLEBOT3, Controller, CONTROLLERS)
    assert controller.parameters.min_vel_theta == 1.37


def test_it_says_why_the_winner_won_and_what_was_ruled_out():
    controller = on_the_way()
    controller.compute_velocity(state(velocity=Twist2D(0.2, 0.0, 0.0), occupied=boxes((0.06, 0.125, 0.5, 0.6))))
    why = controller.explanation
    assert why.totals[why.winner] == why.totals[:-1].min()
    assert why.ruled_out["obstacle"] == np.isinf(why.scores[why.names.index("obstacle")][:-1]).sum() > 0
    text = str(why)
    assert "ruled out: obstacle" in text and "ahead of" in text and "mostly by" in text


def test_the_decisive_critic_is_the_one_with_the_largest_lead():
    velocities = np.array([[0.2, 0, 0], [0.0, 0, 1.0], [0.1, 0, -1.0], [0, 0, 0]], float)
    scores = np.array([[1.0, 2.0, 9.0, 0.0], [1.0, 5.0, np.inf, 0.0]])
    why = Explanation.of((critic("path"), critic("goal")), scores, velocities)
    assert (why.winner, why.runner_up(), why.ruled_out) == (0, 1, {"path": 0, "goal": 1})
    assert str(why).endswith("ahead of (0.00 m/s, 0.00 m/s, 1.00 rad/s) at 7.00 mostly by goal (+4.00)")
    nothing = Explanation.of((critic("path"),), np.array([[np.inf, np.inf, 0.0]]), velocities[[0, 1, 3]])
    assert nothing.winner is None and "nothing is left" in str(nothing)


def test_the_error_explains():
    controller = on_the_way()
    controller.set_path(path_through((0, 0), (1, 0)), True)
    with pytest.raises(ControlError, match="ruled out"):
        for cycle in range(20):
            controller.compute_velocity(
                state(
                    occupied=boxes((0.06, -1, 0.3, 1), (-0.3, -1, -0.125, 1), (-1, 0.12, 1, 1), (-1, -1, 1, -0.12)),
                    now=0.1 * cycle,
                )
            )


def test_a_robot_that_changed_its_mind_and_is_free_to_go_on_does_not_stand_for_ever():
    """Only motion lifts the ban on going ahead again, and it stands with nothing but that in its way."""
    controller = on_the_way()
    controller.set_path(path_through((0, 0), (1.0, 0)), True)
    here = state()
    for speed in (0.2, -0.2):
        for each in controller.critics:
            each.driven(Twist2D(speed, 0.0, 0.0), SimpleNamespace(pose=here.pose))
    assert controller.compute_velocity(here).x > 0.0


def test_a_users_own_critic_has_its_say():
    shy = on_the_way(critics=("obstacle", "path", "goal", "test_dwa.Shy"))
    free = on_the_way(critics=("obstacle", "path", "goal"))
    for controller in (shy, free):
        controller.command = controller.compute_velocity(state(velocity=Twist2D(0.2, 0.0, 0.0)))
    assert free.command.theta > 0.0 >= shy.command.theta
    with pytest.raises(PluginError, match="no_such_critic"):
        on_the_way(critics=("no_such_critic",))


class Odd(Shy):
    """A user's own critic that answers what the test says."""

    answer = None

    def score(self, trajectories, data):
        return self.answer(len(trajectories))


@pytest.mark.parametrize("answer, words", [
    (lambda count: np.where(np.arange(count) == 3, np.nan, 0.0), "ValueError: it scored a trajectory NaN"),
    (lambda count: np.full(count, -np.inf), "it scored a trajectory NaN or -inf"),
    (lambda count: None, "TypeError"),
    (lambda count: np.zeros(3), "ValueError: could not broadcast"),
    (lambda count: {}["door"], r"KeyError: 'door' \(test_dwa\.py, line \d+\)"),
])
def test_a_critic_that_scores_nonsense_drives_nobody_and_is_named(answer, words):
    controller = on_the_way(critics=("obstacle", "path", "goal", "test_dwa.Odd"))
    controller.critics[-1].answer = answer
    with pytest.raises(PluginFailure, match=f"critic 'test_dwa.Odd' failed with .*{words}"):
        controller.compute_velocity(state(velocity=Twist2D(0.2, 0.0, 0.0)))


@pytest.mark.parametrize("scale, kind", [(lambda: 0.5, "function"), ("0.5", "str"), (None, "NoneType")])
def test_a_critic_whose_scale_is_no_number_is_named(monkeypatch, scale, kind):
    """Who forgot @property was told that a method cannot be compared, and not of which of twelve critics."""
    controller = on_the_way(critics=("obstacle", "path", "goal", "test_dwa.Odd"))
    monkeypatch.setattr(Odd, "scale", scale if not callable(scale) else staticmethod(scale))
    with pytest.raises(PluginFailure, match=f"critic 'test_dwa.Odd' failed with TypeError: its scale .* {kind};"):
        controller.compute_velocity(state(velocity=Twist2D(0.2, 0.0, 0.0)))


def test_a_list_of_scores_is_as_good_as_an_array():
    controller = on_the_way(critics=("obstacle", "path", "goal", "test_dwa.Odd"))
    controller.critics[-1].answer = lambda count: [0.0] * count
    assert controller.compute_velocity(state(velocity=Twist2D(0.2, 0.0, 0.0))).x > 0.0


def test_the_built_in_critics_drive_alike_under_names_of_the_users_own():
    built_in = DwaController("DWA", burger())
    own = DwaController(
        "DWA", burger(critics=tuple(f"test_dwa.{OWN[name].__name__}" for name in built_in.parameters.critics))
    )
    corners = [(math.sin(a), 1.0 - math.cos(a)) for a in np.linspace(0.0, 6.0, 60)]
    cylinders = discs((1.2, 0.6, 0.08), (-0.1, 1.75, 0.1), (-1.15, 0.5, 0.05))
    drives = [
        drive(controller, path_through(*corners), Pose2D(0.0, 0.0, 1.5), cylinders, seconds=60.0)
        for controller in (built_in, own)
    ]
    assert drives[0].reached and drives[0].commands == drives[1].commands and drives[0].poses == drives[1].poses


def test_without_a_critic_that_judges_places_the_cheapest_is_driven():
    controller = on_the_way(critics=("obstacle", "twirling"))
    assert controller.compute_velocity(state(velocity=Twist2D(0.2, 0.0, 0.0))).is_finite()


def test_reconfigured_critics_keep_what_they_remember():
    controller = on_the_way()
    before = controller.critics
    controller.reconfigure(controller.parameters.replace(path_distance_bias=5.0))
    assert controller.critics is before and all(c.parameters.path_distance_bias == 5.0 for c in before)
    controller.reconfigure(controller.parameters.replace(critics=("path", "goal", "obstacle")))
    assert [critic.name for critic in controller.critics] == ["path", "goal", "obstacle"]


def test_a_cycle_is_shown_to_whoever_watches():
    seen, controller = [], on_the_way()
    controller.watcher = seen.append
    command = controller.compute_velocity(state(velocity=Twist2D(0.2, 0.0, 0.0)))
    report = seen[-1]
    assert command.x > 0.0 and len(report.trajectory) > 5 and report.explanation
    assert report.path_ahead()[0, :2] == pytest.approx([0.0, 0.0], abs=0.03)
    assert report.path_ahead()[:, 2] == pytest.approx(math.atan2(0.4, 1.0), abs=0.05)
    centers, costs = report.cell_costs()
    assert len(centers) == 3600 and costs.shape == (3600, 3)
    nearest = int(np.argmin(np.hypot(*(centers - (0.5, 0.2)).T)))
    assert (
        costs[nearest, 0] < 0.05 and costs[nearest, 1] > costs[int(np.argmin(np.hypot(*(centers - (0.9, 0.36)).T))), 1]
    )
    controller.set_path(path_through((0, 0), (-1, 0)), True)
    controller.compute_velocity(state(now=10.0))
    assert len(seen[-1].trajectory) == 0, "turning on the spot leads nowhere"


def test_asked_twice_at_one_time_it_accelerates_once():
    controller = on_the_way()
    slow = dict(pose=Pose2D(0.0, 0.0, 0.38), velocity=STOP)
    controller.reconfigure(controller.parameters.replace(acc_lim_x=0.5))
    first = controller.compute_velocity(state(**slow))
    controller.set_path(path_through((0, 0), (1.0, 0.4)), False)
    assert controller.compute_velocity(state(**slow)).x == pytest.approx(first.x) == pytest.approx(0.05)
    assert controller.compute_velocity(state(**{**slow, "now": 0.1})).x == pytest.approx(0.1)


def test_a_sideways_robot_uses_its_legs():
    controller = on_the_way(max_vel_y=0.2, min_vel_y=-0.2, acc_lim_y=2.5, vy_samples=9, twirling_scale=50.0)
    controller.set_path(path_through((0, 0.05), (1.0, 0.05)), True)
    assert controller.compute_velocity(state(velocity=Twist2D(0.15, 0.0, 0.0))).y > 0.0


@pytest.mark.parametrize("given, lowest, highest, told", [
    ({}, 0.0, 0.0, ["max_vel_y"]),
    ({"max_vel_y": 0.0}, 0.0, 0.0, []),
    ({"acc_lim_y": 0.0}, 0.0, 0.0, []),
    ({"max_vel_y": 0.3}, -0.1, 0.3, []),
    ({"max_vel_y": 0.2, "min_vel_y": -0.2}, -0.2, 0.2, []),
])
def test_a_robot_whose_file_says_nothing_of_driving_sideways_is_not_told_to(given, lowest, highest, told):
    """It was told to drive aside by 0.1 m/s, as C++ would have it, which its wheels cannot: it stood, and was given up.
    """
    parameters, notes = DwaParameters.read(given)
    assert (parameters.min_vel_y, parameters.max_vel_y) == (lowest, highest)
    assert [note.split()[1] for note in notes] == told


def test_a_robot_slow_to_turn_follows_a_path_that_bends_to_and_fro():
    """To turn to the other side cost more than it could gain by the turns in reach: it drove straight off its path,
    until that lay 57 degrees aside, stopped and turned on the spot, and so on.
    """
    controller = DwaController("dwa", burger(
        max_vel_x=0.5, max_vel_trans=0.5, max_vel_theta=0.3, min_vel_theta=0.0, acc_lim_x=1.0, acc_lim_theta=0.5))
    path = path_through((0.0, 0.0), (2.0, 0.5), (4.0, 0.0), (6.0, 0.5), (8.0, 0.0))
    driven = drive(controller, path, Pose2D(0.0, 0.0, 0.0), robot=PaperRobot(Pose2D(0.0, 0.0, 0.0), 1.0, 0.5))
    places = np.array([(pose.x, pose.y) for pose in driven.poses])
    gaps = np.hypot(*(places[:, None] - path.poses[None, :, :2]).transpose(2, 0, 1)).min(axis=1)
    assert driven.reached and gaps.max() < 0.3
    assert not any(command.speed() == 0.0 for command in driven.commands[5:-10])


def test_a_robot_that_accelerates_gently_sets_out():
    """In the first fiftieth of a second it came to 1 mm/s, which was not worth it: it stood and was given up."""
    controller = DwaController("dwa", burger(max_vel_x=0.5, max_vel_trans=0.5, acc_lim_x=0.05, acc_lim_theta=0.1))
    start = Pose2D(0.0, 0.0, 0.0)
    driven = drive(
        controller, path_through((0.0, 0.0), (1.0, 0.0)), start, period=0.02, seconds=20.0,
        robot=PaperRobot(start, 0.05, 0.1))
    assert driven.reached, driven.error


@pytest.mark.parametrize("backwards", [0.0, -0.2])
def test_who_asks_why_a_long_robot_stands_at_a_turning_is_told_that_it_cannot_turn_there(backwards):
    """Of 371 velocities none was ruled out, and none left: that was all its owner was told."""
    controller = DwaController("dwa", burger(min_vel_x=backwards))
    long = 0.5 * np.array([(-0.6, -0.2), (0.6, -0.2), (0.6, 0.2), (-0.6, 0.2)])
    walls = boxes((-2.0, -0.3, 2.0, -0.16), (-2.0, 0.16, -0.15, 0.4), (0.15, 0.16, 2.0, 0.4))
    driven = drive(
        controller, path_through((0.0, 0.0), (0.0, 1.5)), Pose2D(0.0, 0.0, 0.0), walls, seconds=20.0,
        costmap=functools.partial(costmap_round, footprint=long), footprint=long)
    told = driven.error.message
    assert "and there is no room to turn there" in told and ("it may not drive backwards" in told) is (backwards == 0.0)


@pytest.mark.parametrize("occdist_scale", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("start", [0.0, 0.25, 0.4])
def test_a_robot_whose_file_weighs_obstacles_much_drives_into_a_narrower_place_that_is_free(occdist_scale, start):
    """By a TurtleBot 2's own file it stood before it, nothing ruled out: to stand cost less than to come nearer."""
    parameters = DwaParameters(
        max_vel_x=0.22, max_vel_trans=0.22, min_vel_x=0.0, path_distance_bias=64.0, goal_distance_bias=24.0,
        occdist_scale=occdist_scale, sim_time=1.0, vx_samples=6, vth_samples=20, foresight=False)
    gap = boxes((0.6, 0.2, 1.0, 2.0), (0.6, -2.0, 1.0, -0.2))
    result = drive(DwaController("DWA", parameters), path_through((0, 0), (1.5, 0)), Pose2D(start, 0.0, 0.0), gap)
    assert result.reached and result.contacts == 0, result.error

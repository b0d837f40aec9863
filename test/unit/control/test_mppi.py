"""MPPI: imagined drives against plain references, its critics, its motion models, and Nav2's names."""

import functools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from kinematics import TURTLEBOT3, boxes, costmap_round, discs, drive, nowhere, path_through

from mbf_relay.control import CONTROLLERS
from mbf_relay.control.braking import brakes_free
from mbf_relay.control.controller import Controller
from mbf_relay.control.mppi import CRITICS, rollout_kernels
from mbf_relay.control.mppi.controller import MppiController
from mbf_relay.control.mppi.critic import CriticFunction
from mbf_relay.control.mppi.parameters import MppiParameters
from mbf_relay.control.state import ControlState, SpeedLimit
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D
from mbf_relay.lockstep.settings import config_folder, load_settings
from mbf_relay.outcomes import ControlError
from mbf_relay.plugins import PluginError, create, find_class

START = Pose2D(0.0, 0.0, 0.0)
BURGER = load_settings(config_folder())["move_base_flex"]["MPPI"]


def make(**changes):
    return create("mppi", "mppi", {**TURTLEBOT3, **BURGER, **changes}, Controller, CONTROLLERS)


def state(pose=START, velocity=STOP, now=0.0, occupied=nowhere):
    return ControlState(now, pose, velocity, costmap_round(pose, occupied), IDENTITY, 0.1)


class Undecided(CriticFunction):
    """A user's own critic that has no number for some drives, as where it divides by nothing."""

    def score(self, rollouts):
        return np.where(rollouts.velocities[:, :, 2].sum(axis=1) > 0.0, np.nan, 0.0)


class Shy(CriticFunction):
    """A user's own critic: a drive that ever turns left is dear."""

    def score(self, rollouts):
        return 1e4 * (rollouts.velocities[:, :, 2] > 1e-9).any(axis=1)


def plain_roll_out(pose, velocity, samples, low, high, accelerations, radius, step):
    """Return poses (T, 3) of one drive by small steps."""
    poses, now, at = [], np.array(velocity, dtype=float), np.array(pose, dtype=float)
    for control in samples:
        wanted = np.clip(control, low, high)
        now = np.clip(wanted, now - accelerations * step, now + accelerations * step)
        if radius > 0.0:
            now[2] = np.clip(now[2], -abs(now[0]) / radius, abs(now[0]) / radius)
        for _ in range(200):
            cos, sin = math.cos(at[2]), math.sin(at[2])
            at = at + np.array([cos * now[0] - sin * now[1], sin * now[0] + cos * now[1], now[2]]) * step / 200
        poses.append(at)
    return np.array(poses)


@pytest.mark.parametrize("lowest", [0.0, -0.2])
def test_an_omnidirectional_robot_may_stand_and_drive_slowly_whether_it_drives_backwards_or_not(lowest):
    controller = make(
        motion_model="Omni", vx_max=0.5, vx_min=lowest, vy_max=0.5, acc_lim_y=2.0, max_vel_trans=0.7)
    critic = next(one for one in controller.critics if one.name == "ConstraintCritic")
    velocities = np.zeros((4, 5, 3))
    velocities[1, :, 0], velocities[2, :, 1], velocities[3, :, 0] = 0.2, -0.4, -0.9
    charges = critic.score(SimpleNamespace(parameters=controller.parameters, velocities=velocities))
    assert charges[:3].tolist() == [0.0, 0.0, 0.0] and charges[3] > 0.0


@pytest.mark.parametrize("radius", [0.0, 0.3])
def test_imagined_drives_are_those_of_a_robot_with_these_limits(radius):
    rng = np.random.default_rng(3)
    controls, noises = rng.normal(0.0, 0.2, (12, 3)), rng.normal(0.0, 0.8, (5, 12, 3)).astype(np.float32)
    low, high, limits = np.array([-0.2, -0.1, -1.5]), np.array([0.4, 0.1, 1.5]), np.array([2.0, 1.0, 3.0])
    samples, velocities, poses = (np.empty((5, 12, 3)) for _ in range(3))
    pose, velocity = np.array([0.3, -0.2, 2.0]), np.array([0.1, 0.0, 0.4])
    rollout_kernels.roll_out(
        pose, velocity, controls, noises, low, high, limits, radius, 0.05, samples, velocities, poses
    )
    assert np.allclose(samples, controls + noises, atol=1e-6)
    for one, driven in zip(samples, poses):
        assert np.allclose(plain_roll_out(pose, velocity, one, low, high, limits, radius, 0.05), driven, atol=2e-4)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_mean_is_of_drives_by_their_worth_and_within_limits(side):
    samples = side * np.array([[[0.5, 0.0, 1.0]], [[0.1, 0.0, -1.0]], [[9.0, 0.0, 0.0]]])
    costs, controls = np.array([0.0, 1.0, 50.0]), np.zeros((1, 3))
    low, high = np.sort(side * np.array([[-1.0, 0.0, -2.0], [0.37, 0.0, 1.0]]), axis=0)
    number = rollout_kernels.blend(costs, samples, np.ones(3), 1.0, 0.0, low, high, controls)
    share = 1.0 / (1.0 + math.exp(-1.0))
    assert 0.5 * share + 0.1 * (1.0 - share) > 0.37
    assert controls[0] == pytest.approx([side * 0.37, 0.0, side * (2 * share - 1.0)])
    assert number == pytest.approx(1.0 / (share ** 2 + (1.0 - share) ** 2))


def test_of_drives_that_cost_alike_the_one_that_leads_on_from_the_last_cycle_s_weighs_less():
    """So Williams et al. have it, and Nav2: what a drive asks for beyond the last cycle's is to be worth it."""
    controls, deviations = np.array([[0.2, 0.0, 0.5], [0.3, 0.0, -0.2]]), np.array([0.1, 1.0, 0.7])
    samples = controls + np.random.default_rng(1).normal(0.0, 1.0, (5, 2, 3)) * (0.1, 0.0, 0.7)
    strayed = (controls * (samples - controls) / deviations ** 2).sum(axis=(1, 2))
    weights = np.exp(-0.3 * strayed / 0.2)
    expected = (weights[:, None, None] * samples).sum(axis=0) / weights.sum()
    rollout_kernels.blend(np.ones(5), samples, deviations, 0.2, 0.3, np.full(3, -9.0), np.full(3, 9.0), controls)
    assert controls == pytest.approx(expected)


def test_noise_leans_to_neither_side_and_is_the_same_for_one_seed():
    one, two, other = make(), make(), make(seed=1)
    noises = one._noises.copy()
    assert np.array_equal(noises, two._noises) and not np.array_equal(noises, other._noises)
    half = len(noises) // 2
    assert np.array_equal(noises[:half], -noises[half:]) and not noises[0].any()
    assert noises[:, :, 0].std() == pytest.approx(0.1, rel=0.1) and not noises[:, :, 1].any()


def test_a_car_never_turns_tighter_than_its_circle_and_arrives():
    controller = make(
        motion_model="Ackermann",
        AckermannConstraints={"min_turning_r": 0.3},
        critics=[*BURGER["critics"], "GoalAngleCritic"],
    )
    ended = drive(controller, path_through((0, 0), (1.2, 0.0), (1.2, 1.0)), START, seconds=40.0)
    commands = np.array(ended.commands)
    assert (np.abs(commands[:, 2]) * 0.3 <= np.abs(commands[:, 0]) + 1e-9).all()
    assert ended.reached, ended


CAR = dict(
    motion_model="Ackermann", AckermannConstraints={"min_turning_r": 0.3}, min_vel_theta=0.0, yaw_goal_tolerance=0.2)


def circles_kept(commands, radius=0.3):
    commands = np.array(commands)
    return (np.abs(commands[:, 2]) * radius <= np.abs(commands[:, 0]) + 1e-9).all()


@pytest.mark.parametrize("heading", [1.5, math.pi, -2.5])
def test_a_car_that_comes_to_its_goal_askew_turns_there_in_several_moves(heading):
    """It stood there until it was said to oscillate."""
    ended = drive(make(**CAR), path_through((0, 0), (1.0, 0.0), end_heading=heading), START, seconds=60.0)
    assert ended.reached and ended.contacts == 0, ended.error
    assert circles_kept(ended.commands)


@pytest.mark.parametrize("heading", [math.pi, 2.5, -2.5])
def test_a_car_whose_path_leads_back_turns_round_between_walls(heading):
    """It stood in the dead end: none of the drives that it imagined began to turn it round."""
    walls = boxes((-1.0, 0.5, 3.0, 0.6), (-1.0, -0.6, 3.0, -0.5))
    start = Pose2D(0.0, 0.0, heading)
    ended = drive(make(**CAR), path_through((0, 0), (2.0, 0.0)), start, walls, seconds=60.0)
    assert ended.reached and ended.contacts == 0, ended.error
    assert circles_kept(ended.commands)


def test_a_car_that_cannot_drive_backwards_drives_a_circle_instead():
    ended = drive(
        make(**CAR, min_vel_x=0.0), path_through((0, 0), (2.0, 0.0)), Pose2D(0.0, 0.0, math.pi), seconds=60.0)
    assert ended.reached, ended.error
    assert circles_kept(ended.commands) and min(command[0] for command in ended.commands) >= 0.0


@pytest.mark.parametrize("tolerance", [0.05, 0.02])
def test_a_robot_that_may_not_drive_backwards_does_not_stand_before_its_goal_for_good(tolerance):
    controller = make(min_vel_x=0.0, vx_min=0.0, xy_goal_tolerance=tolerance)
    ended = drive(controller, path_through((0.0, 0.0), (0.8, 0.1), end_heading=1.2), START, seconds=20.0)
    assert ended.reached, ended.error


def test_an_omnidirectional_robot_goes_aside_without_turning():
    controller = make(
        motion_model="Omni", vy_max=0.22, acc_lim_y=2.5, turn_to_path_angle=4.0, PathAngleCritic={"enabled": False}
    )
    controller.set_path(path_through((0, 0), (0, 1.0), end_heading=0.0), True)
    commands = [controller.compute_velocity(state(now=0.1 * cycle)) for cycle in range(10)]
    assert commands[-1].y > 0.1 and abs(commands[-1].theta) < 0.5


@pytest.mark.parametrize("given, limits", [
    ({"max_vel_y": 0.2}, (-0.2, 0.2)), ({"min_vel_y": -0.3}, (-0.3, 0.3)),
    ({"max_vel_y": 0.2, "min_vel_y": 0.0}, (0.0, 0.2)), ({}, (-0.5, 0.5)),
    ({"max_vel_y": 0.2, "vy_max": 0.1}, (-0.1, 0.1)), ({"max_vel_y": 0.0}, (0.0, 0.0)),
    ({"max_vel_y": "2e-1"}, (-0.2, 0.2)), ({"min_vel_y": " -0.3"}, (-0.3, 0.3)), ({"vy_max": "0.1"}, (-0.1, 0.1)),
])
def test_an_omnidirectional_robot_whose_file_names_one_side_goes_to_either(given, limits):
    """It went to the left and never to the right; where YAML takes the number for a text, always to one, at full speed.
    """
    parameters, _notes = MppiParameters.read({"motion_model": "Omni", "acc_lim_y": 2.5, **given})
    assert (parameters.min_vel_y, parameters.max_vel_y) == limits


def test_numbers_that_yaml_takes_for_texts_set_what_follows_from_them_too():
    """A robot that was to drive 1.5 m/s drove 0.5, and one that was to brake by 1 m/s^2 was refused."""
    texts = {"vx_max": "15e-1", "wz_max": "3e-1", "ax_min": "-1e0"}
    taken, _notes = MppiParameters.read(texts)
    assert taken == MppiParameters.read({name: float(text) for name, text in texts.items()})[0]
    assert (taken.max_vel_trans, taken.min_vel_theta, taken.acc_lim_x) == (1.5, 0.3, 1.0)


def test_names_of_nav2s_files_mean_what_they_mean_there():
    values = {
        "vx_max": 0.4,
        "vx_min": -0.1,
        "vy_max": 0.3,
        "wz_max": 1.2,
        "ax_max": 2.0,
        "ax_min": -1.5,
        "motion_model": "Omni",
    }
    parameters = MppiParameters.from_mapping(values)
    assert (parameters.max_vel_x, parameters.min_vel_x, parameters.max_vel_theta) == (0.4, -0.1, 1.2)
    assert (parameters.min_vel_y, parameters.max_vel_y, parameters.acc_lim_x) == (-0.3, 0.3, 1.5)
    assert parameters.max_vel_trans == pytest.approx(0.5)
    assert MppiParameters.unknown_names({**values, "visualize": True, "vx_maks": 1.0}) == ["vx_maks"]


@pytest.mark.parametrize("changes, word", [
    ({"critics": ["PathCritic"]}, "PathCritic"), ({"motion_model": "Crab"}, "motion_model"),
    ({"CostCritic": {"cost_weight": "dear"}}, "cost_weight"), ({"critics": [[]]}, "critics"),
])
def test_what_cannot_be_is_named(changes, word):
    with pytest.raises(PluginError, match=word):
        make(**changes)


def test_a_critic_of_ones_own_is_heard():
    path = path_through((0, 0), (0.5, 0), (1.0, 0.5))
    plain, shy = make(), make(critics=[*BURGER["critics"], f"{__name__}.Shy"])
    ways = [drive(controller, path, START, seconds=4.0).commands for controller in (plain, shy)]
    assert max(command.theta for command in ways[0]) > 0.2 > max(command.theta for command in ways[1])


@pytest.mark.parametrize("later", [5.0, -3.0])
def test_a_robot_that_was_paused_does_not_go_on_with_the_drive_of_before(later):
    fresh, used = make(), make()
    for controller in (fresh, used):
        controller.set_path(path_through((0.0, 0.0), (1.0, 0.3)), True)
    for cycle in range(5):
        before = used.compute_velocity(state(now=0.1 * cycle))
    command, begun = (controller.compute_velocity(state(now=0.4 + later)) for controller in (used, fresh))
    assert command == begun != before


def looked_at(controller, *where):
    """Return what critics look at in a cycle of a controller; its first critic charges nothing then."""
    seen = []
    controller.critics[0].score = lambda rollouts: seen.append(rollouts) or 0.0
    controller.compute_velocity(*where)
    return seen[0]


def test_where_the_robot_is_to_go_slowly_no_faster_drive_is_imagined():
    controller = make()
    controller.limit_speed(SpeedLimit(share=0.5))
    controller.set_path(path_through((0.0, 0.0), (1.0, 0.3)), True)
    velocities = np.abs(looked_at(controller, state()).velocities).max(axis=(0, 1))
    assert velocities[0] == pytest.approx(0.11) and velocities[2] <= 1.375 + 1e-9


def test_a_path_that_leads_out_of_the_costmap_is_not_taken_for_blocked():
    controller = make()
    controller.set_path(path_through((0.0, 0.0), (3.0, 0.0)), True)
    here = costmap_round(START, boxes((0.4, -0.1, 0.45, 0.1)), size=1.0)
    rollouts = looked_at(controller, ControlState(0.0, START, STOP, here, IDENTITY, 0.1))
    ahead = rollouts.path[:, 0]
    assert rollouts.path_is_free[ahead > 0.5].all() and not rollouts.path_is_free[(ahead > 0.4) & (ahead < 0.45)].any()


def test_a_robot_beside_the_end_of_its_path_is_not_taken_to_be_at_its_goal():
    controller = make()
    controller.set_path(path_through((0.0, 0.0), (1.0, 0.0)), True)
    beside = state(pose=Pose2D(0.9, 0.4, -1.3))
    assert looked_at(controller, beside).goal_distance == pytest.approx(math.hypot(0.1, 0.4))


def test_a_robot_drives_on_where_a_critic_of_ones_own_has_no_number_for_some_drives():
    controller = make(critics=[*BURGER["critics"], f"{__name__}.Undecided"])
    assert drive(controller, path_through((0, 0), (0.5, 0.0)), START, seconds=10.0).reached


def test_a_car_that_faces_away_from_its_path_on_a_coarse_map_is_not_drawn_to_its_end():
    """No imagined drive got ahead: points were counted from the path's end, and it was to face one there."""
    controller = make(motion_model="Ackermann", min_turning_r=1.0, min_vel_x=0.0, acc_lim_x=0.2)
    controller.set_path(path_through((0.0, 0.0), (9.0, 0.0)), True)
    pose = Pose2D(0.99, 0.0, math.pi)
    here = costmap_round(pose, size=6.0, resolution=0.5)
    assert looked_at(controller, ControlState(0.0, pose, Twist2D(0.2, 0.0, 0.0), here)).furthest == 0


def test_every_critic_gives_each_drive_a_finite_cost():
    controller = make(critics=sorted(CRITICS), motion_model="Ackermann")
    controller.set_path(path_through((0, 0), (0.4, 0.1)), True)
    controller.compute_velocity(state(occupied=boxes((0.3, -0.3, 0.35, -0.1))))
    assert np.isfinite(controller.costs).all() and controller.costs.shape == (1000,)
    for name in CRITICS:
        assert issubclass(find_class(name, CriticFunction, CRITICS), CriticFunction)


def test_no_command_is_given_from_which_the_robot_could_not_brake():
    fast, driven = Twist2D(0.22, 0.0, 0.0), 0
    for number in range(40):
        rng = np.random.default_rng(number)
        controller = make(seed=number)
        controller.set_path(path_through((0, 0), (1.0, rng.uniform(-0.5, 0.5))), True)
        for cycle in range(5):
            controller.compute_velocity(state(velocity=fast, now=0.1 * cycle))
        posts = discs(*((*rng.uniform((0.1, -0.3), (0.5, 0.3)), 0.04) for _ in range(3)))  # come into sight now
        seen = state(velocity=fast, now=0.5, occupied=posts)
        try:
            command = controller.compute_velocity(seen)
        except ControlError:
            continue
        driven += command.x > 0.0
        assert brakes_free(controller.parameters, seen, FootprintChecker(seen.costmap), command), number
    assert driven > 10


@pytest.mark.parametrize("critic", ["CostCritic", "ObstaclesCritic"])
def test_a_robot_whose_costmap_ends_a_few_hand_s_breadths_ahead_drives_on(critic):
    """Each imagined drive that led out of it counted as one into an obstacle: it crept, or stood where it is fast."""
    controller = make(critics=[critic if name == "CostCritic" else name for name in BURGER["critics"]])
    small = functools.partial(costmap_round, size=0.8, resolution=0.05)
    driven = drive(controller, path_through((0.0, 0.0), (4.0, 0.0)), START, seconds=23.0, costmap=small)
    assert driven.reached, driven.error


@pytest.mark.parametrize("aside", [0.0, 0.08])
def test_a_doorway_that_leaves_half_a_centimetre_on_either_side_is_driven_through(aside):
    """It stood before it, though the path led through the middle: every drive that was imagined touched a jamb."""
    door, fine = boxes((0.6, 0.111, 0.7, 1.0), (0.6, -1.0, 0.7, -0.111)), functools.partial(
        costmap_round, size=1.6, resolution=0.005)
    ended = drive(make(), path_through((0.0, -aside), (0.4, 0.0), (1.1, 0.0)), Pose2D(0.0, -aside, 0.0), door,
                  seconds=20.0, costmap=fine)
    assert ended.reached and not ended.contacts, ended.error


def test_where_every_drive_is_worse_than_standing_the_reason_is_told():
    controller = make()
    controller.set_path(path_through((0, 0), (1.0, 0.0)), True)
    around = boxes((-0.3, -0.3, 0.3, -0.13), (-0.3, 0.13, 0.3, 0.3), (-0.3, -0.3, -0.13, 0.3), (0.07, -0.3, 0.3, 0.3))
    with pytest.raises(ControlError, match="standing|without touching"):
        for cycle in range(10):
            controller.compute_velocity(state(now=0.1 * cycle, occupied=around))


def test_a_batch_as_small_as_allowed_still_drives():
    ended = drive(make(batch_size=1), path_through((0, 0), (0.3, 0.0)), START, seconds=10.0)
    assert ended.contacts == 0 and ended.poses[-1].x > 0.1


def test_new_parameters_resize_the_batch():
    controller = make()
    controller.set_path(path_through((0, 0), (1.0, 0.0)), True)
    controller.compute_velocity(state())
    controller.reconfigure(controller.parameters.replace(batch_size=200, time_steps=30))
    assert isinstance(controller, MppiController) and isinstance(controller.compute_velocity(state(now=0.1)), Twist2D)
    assert controller.controls.shape == (30, 3) and controller.costs.shape == (200,)


@pytest.mark.parametrize("model", ["Ackermann", "DiffDrive"])
def test_a_car_that_stands_with_its_wheels_turned_does_not_count_as_driving(model):
    """It told whoever sent it that it drove, at a tenth of a millimetre a second, until its time was up."""
    controller = make(motion_model=model)
    controller.set_path(path_through((0.0, 0.0), (3.0, 0.0)), True)
    cycle = controller.look_around(state())
    controller.controls[:] = (1e-4, 0.0, 0.5)
    assert controller._puts_off(cycle) == (model == "Ackermann")
    controller.controls[:] = (0.1, 0.0, 0.5)
    assert not controller._puts_off(cycle)

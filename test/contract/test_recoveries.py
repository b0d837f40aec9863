"""What every recovery behaviour owes whoever runs it, and what each does."""

import math
import os
import sys

import numpy as np
import pytest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from kinematics import TURTLEBOT3, PaperRobot, boxes, costmap_round, discs, nowhere, touches  # noqa: E402

from mbf_relay.control.dwa import DwaController  # noqa: E402
from mbf_relay.control.dwa_parameters import DwaParameters  # noqa: E402
from mbf_relay.control.state import SpeedLimit  # noqa: E402
from mbf_relay.geometry import STOP, Pose2D, Twist2D, normalize_angle  # noqa: E402
from mbf_relay.outcomes import RecoveryError, RecoveryOutcome, StaleDataError, TransformError  # noqa: E402
from mbf_relay.plugins import create  # noqa: E402
from mbf_relay.recovery import RECOVERIES  # noqa: E402
from mbf_relay.recovery.recovery import Recovery, RecoveryContext  # noqa: E402

NAMES = sorted(RECOVERIES)
CLEAR, ROTATE = "clear_costmap_recovery/ClearCostmapRecovery", "rotate_recovery/RotateRecovery"
SLOW = "move_slow_and_clear/MoveSlowAndClear"


class PaperLayer:
    def __init__(self, name):
        self.name = name


class PaperCostmap:
    """A costmap as behaviours use it: a snapshot made from obstacles, and a note of what was cleared."""

    def __init__(self, world, frame, layers=("static_layer", "obstacle_layer")):
        self.world, self.frame = world, frame
        self.layers = [PaperLayer(name) for name in layers]
        self.cleared, self.updates, self.stale = [], 0, None

    def snapshot(self):
        return costmap_round(self.world.robot.pose, self.world.occupied, now=self.world.updated)

    def stale_reason(self, now):
        return self.stale

    def clear(self, layers=None, around=None, side=math.inf, inside=True):
        self.cleared.append((tuple(layers), tuple(around), side, inside))

    def update(self, now, pose):
        self.updates += 1


class PaperWorld(RecoveryContext):
    """Drives a behaviour as navigation does: a step a period, closed at any of them."""

    def __init__(self, occupied=nowhere, controller=None, period=0.05):
        self.robot, self.occupied = PaperRobot(Pose2D(0.0, 0.0, 0.0), 2.5), occupied
        self._costmaps = {"local": PaperCostmap(self, "odom"), "global": PaperCostmap(self, "map")}
        self._controller, self._now, self._period = controller, 100.0, period
        self.updated, self.lost, self.blind, self.touched, self.wheels_free = 99.9, False, False, 0, True
        self.commands = []

    now = property(lambda self: self._now)
    period = property(lambda self: self._period)
    costmaps = property(lambda self: self._costmaps)
    controller = property(lambda self: self._controller)

    @property
    def velocity(self):
        if self.blind:
            raise StaleDataError("no odometry for 3.0 s")
        return self.robot.velocity

    def pose_in(self, frame):
        if self.lost:
            raise TransformError(f"no transform to '{frame}'")
        return self.robot.pose

    def step(self, command):
        self.commands.append(command)
        self.robot.move(command if self.wheels_free else STOP, self._period)
        self._now += self._period
        if len(self.commands) % 4 == 0:
            self.updated = self._now
        self.touched += touches(self.robot.pose, self.occupied)

    def set_clock(self, seconds):
        """Set time forward or back; the costmaps show what was seen before until they are updated anew."""
        self._now += seconds

    def run(self, behavior, steps=1000):
        for _, command in zip(range(steps), behavior.run(self)):
            self.step(command)
        return self


def make(name, **values):
    return create(name, name, values, Recovery, RECOVERIES)


@pytest.mark.parametrize("name", NAMES)
def test_it_ends_with_finite_velocities(name):
    world = PaperWorld(controller=DwaController("DWA", DwaParameters(**TURTLEBOT3))).run(make(name))
    assert len(world.commands) < 300 and all(command.is_finite() for command in world.commands)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("steps", [0, 1, 7])
def test_it_can_be_closed_between_any_two_steps(name, steps):
    world, behavior = PaperWorld(), make(name)
    running = behavior.run(world)
    for _, command in zip(range(steps), running):
        world.step(command)
    running.close()
    assert next(running, None) is None
    again = PaperWorld().run(behavior)
    assert [tuple(c) for c in again.commands] == [tuple(c) for c in PaperWorld().run(make(name)).commands]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seconds", [-3600.0, -3.0, -0.4, 0.4, 3600.0])
@pytest.mark.parametrize("wheels_free", [True, False])
def test_a_robot_whose_clock_is_set_or_that_is_paused_meanwhile_is_not_left_standing(name, seconds, wheels_free):
    """One that backed up was told after a pause to look after its wheels."""
    world, behavior = PaperWorld(controller=DwaController("DWA", DwaParameters(**TURTLEBOT3))), make(name)
    if name == ROTATE and not wheels_free:
        pytest.skip("it turns until it has come round; whoever runs it has the patience for that")
    world.wheels_free, running = wheels_free, behavior.run(world)
    for _, command in zip(range(2), running):
        world.step(command)
    world.set_clock(seconds)
    try:
        for _, command in zip(range(1000), running):
            world.step(command)
    except RecoveryError as error:
        assert not wheels_free, error
    assert len(world.commands) < 300


@pytest.mark.parametrize("name", [ROTATE, "back_up"])
class TestMoving:
    def test_it_accelerates_and_brakes_gently(self, name):
        commands = np.array(PaperWorld().run(make(name)).commands)
        steps = np.abs(np.diff(np.vstack((np.zeros(3), commands)), axis=0))
        assert steps[:, 0].max() <= 1.0 * 0.05 + 1e-9 and steps[:, 2].max() <= 3.2 * 0.05 + 1e-9
        assert np.abs(commands[:, 2]).max() <= 1.0 + 1e-9 and np.abs(commands[:, 0]).max() <= 0.1 + 1e-9

    @pytest.mark.parametrize("trouble, outcome", [
        (dict(lost=True), RecoveryOutcome.TF_ERROR), (dict(blind=True), RecoveryOutcome.FAILURE),
    ])
    def test_it_does_not_move_blindly(self, name, trouble, outcome):
        world = PaperWorld()
        vars(world).update(trouble)
        with pytest.raises(RecoveryError) as refused:
            world.run(make(name))
        assert refused.value.outcome is outcome and not any(c != STOP for c in world.commands)

    def test_a_stale_costmap_stops_it(self, name):
        world = PaperWorld()
        running = make(name).run(world)
        world.step(next(running))
        world.costmaps["local"].stale = "scan is 2.0 s old"
        with pytest.raises(RecoveryError, match="2.0 s old"):
            next(running)

    def test_shut_in_it_says_impassable_and_stands(self, name):
        world = PaperWorld(boxes((-1, 0.115, 1, 0.3), (-1, -0.3, 1, -0.115), (-0.3, -1, -0.12, 1), (0.06, -1, 0.3, 1)))
        with pytest.raises(RecoveryError) as refused:
            world.run(make(name))
        assert refused.value.outcome is RecoveryOutcome.IMPASSABLE
        assert not any(command != STOP for command in world.commands) and world.touched == 0


def test_rotate_comes_round_once():
    turned, world, last = 0.0, PaperWorld(), 0.0
    for command in make(ROTATE).run(world):
        world.step(command)
        turned += normalize_angle(world.robot.pose.theta - last)
        last = world.robot.pose.theta
    assert abs(turned) == pytest.approx(2 * math.pi, abs=0.15)


def test_rotate_stops_for_what_comes_in_its_way():
    world = PaperWorld()
    behavior = make(ROTATE)
    with pytest.raises(RecoveryError) as refused:
        for command in behavior.run(world):
            world.step(command)
            if len(world.commands) == 30:
                world.occupied = discs((0.0, 0.19, 0.04), (0.0, -0.19, 0.04), (-0.19, 0.0, 0.04), (0.17, 0.0, 0.04))
    assert refused.value.outcome is RecoveryOutcome.IMPASSABLE and world.touched == 0


@pytest.mark.parametrize("name, moving, change", [
    (ROTATE, Twist2D(0.0, 0.0, 1.0), 0.16), (ROTATE, Twist2D(0.0, 0.0, -1.0), 0.16),
    ("back_up", Twist2D(-0.3, 0.0, 0.0), 0.05)])
def test_a_robot_that_moves_already_goes_on_from_that_and_is_not_jerked_to_a_stand(name, moving, change):
    world = PaperWorld()
    world.robot.velocity = moving
    for before, command in zip(iter(lambda: world.velocity, None), make(name).run(world)):
        assert abs(command.theta - before.theta) + abs(command.x - before.x) <= 3.0 * change + 1e-9
        world.step(command)
    assert len(world.commands) > 3 and world.velocity.speed() < 0.1


def test_back_up_goes_as_far_as_asked_or_as_there_is_room():
    world = PaperWorld().run(make("back_up", distance=0.2))
    assert world.robot.pose.x == pytest.approx(-0.2, abs=0.015) and STOP not in world.commands, "there it waits"
    world = PaperWorld(boxes((-0.3, -1, -0.2, 1))).run(make("back_up", distance=0.3))
    assert -0.1 < world.robot.pose.x < -0.02 and world.touched == 0


@pytest.mark.parametrize("speed", [-0.15, 0.15])
def test_a_car_that_is_to_step_back_and_steer_steps_back(speed):
    """Its behaviour is another package's, which was refused: it had nothing left that brings a car out of a corner."""
    name = "step_back_and_max_steer_recovery/StepBackAndMaxSteerRecovery"
    behaviour = make(name, step_back_length=0.4, linear_vel_back=speed, turn_angle=1.5)
    (note,) = behaviour.notes
    assert name in note and "does not steer" in note
    world = PaperWorld().run(behaviour)
    assert world.robot.pose.x == pytest.approx(-0.4, abs=0.015)
    assert min(command.x for command in world.commands) == pytest.approx(-0.15)


def test_back_up_notices_wheels_that_do_not_turn():
    world = PaperWorld()
    world.wheels_free = False
    with pytest.raises(RecoveryError, match="wheels") as stuck:
        world.run(make("back_up", timeout=2.0))
    assert stuck.value.outcome is RecoveryOutcome.PAT_EXCEEDED


def test_who_backs_up_slowly_is_not_told_to_see_to_the_wheels():
    """As in a zone of walking pace, which slows what a behaviour wants."""
    world = PaperWorld().run(make("back_up", distance=1.0, speed=0.05, timeout=4.0))
    assert -0.25 < world.robot.pose.x < -0.15


def test_clear_clears_the_layers_named_and_waits_for_what_is_seen_now():
    world = PaperWorld()
    world.updated = 100.0  # already in the snapshot before clearing
    world.run(make(CLEAR, reset_distance=1.84))
    for costmap in world.costmaps.values():
        assert costmap.cleared == [(("obstacles", "obstacle_layer"), (0.0, 0.0, 0.0), 1.84, False)]
    assert all(command == STOP for command in world.commands)
    assert world.costmaps["local"].snapshot().stamp > 100.0


@pytest.mark.parametrize(
    "values, cleared", [({"affected_maps": "local"}, ["local"]), ({"affected_maps": "global"}, ["global"])]
)
def test_clear_clears_only_the_map_asked_for(values, cleared):
    world = PaperWorld().run(make(CLEAR, force_updating=True, invert_area_to_clear=True, **values))
    assert [name for name, costmap in world.costmaps.items() if costmap.cleared] == cleared
    assert world.costmaps[cleared[0]].updates == 1 and world.costmaps[cleared[0]].cleared[0][3] is True


def test_who_updates_the_maps_at_once_does_not_stand_for_their_next_update():
    world = PaperWorld()
    world.updated = world.now  # what updating at once leaves; no update follows, as from a costmap of a low frequency
    world.run(make(CLEAR, force_updating=True))
    assert len(world.commands) == 1 and all(costmap.updates == 1 for costmap in world.costmaps.values())


def test_clear_clears_both_maps_where_there_is_no_map_of_that_name_as_upstream_s_does():
    behavior = make(CLEAR, affected_maps="all")
    world = PaperWorld().run(behavior)
    assert all(costmap.cleared for costmap in world.costmaps.values())
    assert any("'all'" in note and "both is used" in note for note in behavior.notes)


def test_clear_says_what_layers_there_are():
    with pytest.raises(RecoveryError, match="static_layer") as refused:
        PaperWorld().run(make(CLEAR, layer_names=["voxels"]))
    assert refused.value.outcome is RecoveryOutcome.FAILURE


@pytest.mark.parametrize("name", [CLEAR, SLOW])
def test_clearing_needs_the_robots_place(name):
    world = PaperWorld()
    world.lost = True
    with pytest.raises(RecoveryError) as refused:
        world.run(make(name))
    assert refused.value.outcome is RecoveryOutcome.TF_ERROR


def test_move_slow_limits_the_controller_that_failed_for_a_while():
    controller = DwaController("DWA", DwaParameters(**TURTLEBOT3))
    world = PaperWorld(controller=controller).run(make(SLOW, limited_trans_speed=0.08, limited_rot_speed=0.5))
    assert world.costmaps["local"].cleared[0][2:] == (1.0, True)
    assert controller.speed_limit_at(Pose2D(0.0, 0.0, 0.0)) == SpeedLimit(0.08, 0.5, 0.3)
    assert controller.speed_limit_at(Pose2D(0.31, 0.0, 0.0)) == SpeedLimit()


@pytest.mark.parametrize("values, cleared", [
    ({}, ("laserobstacles", "obstacles_rgbd", "obstacle_layer")), ({"layer_names": ["sonar"]}, ("sonar",)),
])
def test_move_slow_clears_all_layers_of_obstacles_as_upstream_s_does(values, cleared):
    world = PaperWorld()
    layers = ("static_layer", "laserobstacles", "obstacles_rgbd", "obstacle_layer", "sonar")
    world.costmaps["local"].layers = [PaperLayer(name) for name in layers]
    world.run(make(SLOW, **values))
    assert world.costmaps["local"].cleared[0][0] == cleared


def test_wait_stands_for_its_time():
    world = PaperWorld().run(make("wait", duration=1.5))
    assert world.now - 100.0 == pytest.approx(1.5, abs=0.06) and set(world.commands) == {Twist2D(0.0, 0.0, 0.0)}

"""Recovery behaviours: steps, patience, cancelling and cleaning up."""

import math

import pytest
import scripted
from scripted import FORWARD

from mbf_relay.costmap.layer import ZoneLimit
from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.navigation.goals import FollowGoal, RecoverGoal
from mbf_relay.navigation.recovery_execution import RecoverySurroundings
from mbf_relay.navigation.task import Ending
from mbf_relay.outcomes import RecoveryError, RecoveryOutcome, StaleDataError, TransformError


def steps(count, velocity=FORWARD):
    return lambda context: (velocity for _ in range(count))


def test_a_behaviour_drives_step_by_step_and_ends_with_a_zero(bench):
    bench.script.recovery = steps(5)
    result = bench.finish(bench.navigator.recovery(RecoverGoal("R2")))
    assert result.outcome is RecoveryOutcome.SUCCESS and result.used_plugin == "R2"
    assert bench.robot.sent == [FORWARD] * 5 + [STOP]
    assert bench.robot.pose.x == pytest.approx(0.1)


def test_a_behaviour_that_yields_no_velocity_is_told_so_and_has_not_succeeded(bench):
    def drive(_context):
        yield
        yield FORWARD

    bench.script.recovery = drive
    task = bench.navigator.recovery(RecoverGoal("R2"))
    result = bench.finish(task)
    assert task.ending is Ending.ABORTED and result.outcome is RecoveryOutcome.INTERNAL_ERROR
    assert "it yielded None" in result.message


def test_a_behaviour_is_asked_at_the_controller_s_rate_however_often_navigation_is_stepped(bench):
    periods = []

    def drive(context):
        while True:
            periods.append(context.period)
            yield FORWARD

    bench.script.recovery = drive
    bench.navigator.recovery(RecoverGoal("R2"))
    for _ in range(100):
        bench.step(0.01)
    assert len(bench.robot.sent) == pytest.approx(10, abs=1) and set(periods) == {0.1}


def test_a_behaviour_that_is_waited_for_for_ever_takes_its_time(make_bench):
    bench = make_bench(recovery_patience=0.0)
    bench.script.recovery = steps(500)
    assert bench.finish(bench.navigator.recovery(RecoverGoal("R2"))).outcome is RecoveryOutcome.SUCCESS


@pytest.mark.parametrize("blind", [
    lambda bench, why: setattr(bench.costmaps["local"], "stale", why),
    lambda bench, why: setattr(bench.robot, "stale", why)], ids=["no scan", "no odometry"])
def test_a_robot_does_not_set_out_blind_by_a_behaviour_that_does_not_look(bench, blind):
    bench.script.recovery = steps(100)
    blind(bench, "3.0 s old")
    bench.navigator.recovery(RecoverGoal("R2"))
    for _ in range(5):
        bench.step()
    assert set(bench.robot.sent) == {STOP}
    blind(bench, None)
    bench.step()
    assert bench.robot.sent[-1] == FORWARD


@pytest.mark.parametrize("velocity, zone, driven", [
    (Twist2D(-0.2, 0.0, 0.0), ZoneLimit(0.05), Twist2D(-0.05, 0.0, 0.0)),
    (Twist2D(-0.2, 0.0, 0.4), ZoneLimit(0.05), Twist2D(-0.05, 0.0, 0.1)),
    (Twist2D(-0.2, 0.0, 0.0), ZoneLimit(share=0.25), Twist2D(-0.1, 0.0, 0.0)),
    (Twist2D(0.0, 0.0, 1.0), ZoneLimit(share=0.25), Twist2D(0.0, 0.0, 0.5)),
    (Twist2D(-0.2, 0.0, 1.0), ZoneLimit(0.3, 0.75), Twist2D(-0.2, 0.0, 1.0))])
def test_a_robot_that_recovers_in_a_zone_of_walking_pace_keeps_to_it(bench, monkeypatch, velocity, zone, driven):
    """It backed up and turned as fast as anywhere: percents are of what its controller drives at most, as elsewhere."""
    monkeypatch.setattr(scripted.ScriptedController, "top_speeds", (0.4, 2.0))
    bench.script.recovery = steps(3, velocity)
    bench.costmaps["global"].zone_limit = zone
    assert bench.finish(bench.navigator.recovery(RecoverGoal("R2"))).outcome is RecoveryOutcome.SUCCESS
    assert bench.robot.sent == [pytest.approx(tuple(driven))] * 3 + [STOP]


def test_a_cancel_during_the_very_step_wins(bench):
    def drive(context):
        yield FORWARD
        task.cancel()
        yield FORWARD

    bench.script.recovery = drive
    task = bench.navigator.recovery(RecoverGoal("R2"))
    bench.finish(task)
    assert task.ending is Ending.CANCELED and bench.robot.sent == [FORWARD, STOP]


def test_a_behaviour_is_told_where_a_robot_of_late_wheels_will_be_and_how_it_will_move(bench):
    robot, context = bench.robot, RecoverySurroundings(bench.robot, bench.costmaps, None)
    robot.commanded, robot.reported = FORWARD, Twist2D(0.1, 0.0, 0.0)
    assert context.velocity == robot.reported and context.pose_in("odom") == robot.pose
    robot.delay.tell(0.0, FORWARD)
    robot.delay.note(1.0, robot.reported)
    robot.delay.seconds = 0.5
    assert context.velocity == FORWARD and context.pose_in("odom").x == pytest.approx(0.1)
    assert context.pose_in("base") == robot.pose, "of a frame no costmap is in"
    robot.commanded = None
    assert context.velocity == robot.reported


def test_the_first_behaviour_is_taken_where_none_is_named(bench):
    assert bench.finish(bench.navigator.recovery(RecoverGoal())).used_plugin == "R1"


@pytest.mark.parametrize("error, outcome", [
    (RecoveryError(RecoveryOutcome.IMPASSABLE, "no room to turn"), RecoveryOutcome.IMPASSABLE),
    (TransformError("no transform"), RecoveryOutcome.TF_ERROR),
    (StaleDataError("odometry is 2.00 s old"), RecoveryOutcome.FAILURE),
])
def test_a_behaviour_that_gives_up_ends_succeeded_with_its_outcome_as_upstream(bench, error, outcome):
    def give_up(context):
        yield FORWARD
        raise error

    bench.script.recovery = give_up
    task = bench.navigator.recovery(RecoverGoal("R1"))
    assert bench.finish(task).outcome is outcome and task.ending is Ending.SUCCEEDED


@pytest.mark.parametrize("velocity", [
    Twist2D(math.nan, 0.0, 0.0), Twist2D(0.0, 0.0, -1e9), Twist2D("0.1", 0.0, 0.0), "fast", (1.0,)])
def test_nonsense_never_reaches_the_wheels(bench, velocity):
    bench.script.recovery = steps(3, velocity)
    task = bench.navigator.recovery(RecoverGoal("R1"))
    assert bench.finish(task).outcome is RecoveryOutcome.INTERNAL_ERROR and task.ending is Ending.ABORTED
    assert set(bench.robot.sent) == {STOP}


def test_a_cancel_takes_effect_between_two_steps_and_cleans_up(bench):
    bench.script.recovery = steps(1000)
    task = bench.navigator.recovery(RecoverGoal("R1"))
    bench.step()
    bench.step()
    task.cancel()
    bench.step(0.01)
    assert task.ending is Ending.CANCELED and bench.script.cleaned_up == 1
    assert bench.robot.sent == [FORWARD, FORWARD, STOP]


def in_its_second_step(bench):
    """Return the task of a behaviour that drives, and whose next step hangs."""
    bench.script.recovery = steps(1000)
    bench.worker.delays = [1, None]
    task = bench.navigator.recovery(RecoverGoal("R1"))
    bench.run(lambda: FORWARD in bench.robot.sent)
    return task


def test_a_step_that_hangs_can_be_cancelled_and_cleans_up_when_it_returns(held_bench):
    bench, task = held_bench, in_its_second_step(held_bench)
    bench.step()
    task.cancel()
    bench.step(0.01)
    assert task.ending is Ending.CANCELED and bench.robot.sent[-1] == STOP and bench.script.cleaned_up == 0
    bench.worker.release()
    assert bench.script.cleaned_up == 1


def test_a_robot_does_not_roll_on_while_a_step_hangs(held_bench):
    bench, task = held_bench, in_its_second_step(held_bench)
    for _ in range(5):
        bench.step()
    assert bench.robot.sent[-1] == STOP and bench.robot.sent.count(STOP) == 1
    bench.worker.release()
    bench.step()
    assert bench.robot.sent[-1] == FORWARD
    task.cancel()
    bench.finish(task)
    bench.worker.release()  # it cleans up


def test_a_robot_does_not_set_off_by_what_a_behaviour_saw_before_it_hung(held_bench):
    bench, task = held_bench, in_its_second_step(held_bench)
    for _ in range(13):
        bench.step()
    sent = len(bench.robot.sent)
    bench.worker.release()
    bench.step(0.0)
    assert bench.robot.sent[sent - 1:] in ([STOP], [STOP, STOP])
    bench.run(lambda: bench.robot.sent[-1] == FORWARD, 0.5)
    task.cancel()
    bench.finish(task)
    bench.worker.release()  # it cleans up


def test_a_behaviour_called_off_in_the_moment_it_ends_ends_once(held_bench):
    """It ended a second time, an internal error that ends everybody's goals."""
    bench = held_bench
    bench.script.recovery = steps(1)
    task = bench.navigator.recovery(RecoverGoal("R1"))
    bench.run(lambda: FORWARD in bench.robot.sent)
    task.cancel()
    bench.step()
    assert task.ending is Ending.CANCELED and bench.robot.sent == [FORWARD, STOP]


def test_what_was_called_off_before_a_behaviour_that_hung_could_begin_it_is_not_begun(held_bench):
    bench, task = held_bench, in_its_second_step(held_bench)
    for _ in range(2):
        bench.step()
        task.cancel()
        bench.step()
        task = bench.navigator.recovery(RecoverGoal("R1"))
    for _ in range(3):
        bench.worker.release()
    assert bench.script.calls["R1"] == 1 and bench.script.cleaned_up == 1


def test_a_server_without_controllers_recovers(make_bench):
    bench = make_bench(controllers=[])
    bench.script.recovery = steps(5)
    assert bench.finish(bench.navigator.recovery(RecoverGoal("R1"))).outcome is RecoveryOutcome.SUCCESS
    assert bench.robot.sent == [FORWARD] * 5 + [STOP]


def test_how_late_the_wheels_are_is_learnt_from_recoveries_too(bench):
    noted = []
    bench.robot.note_motion = lambda now, velocity: noted.append((round(now - 1000.0, 3), velocity))
    bench.script.recovery = steps(2)
    bench.finish(bench.navigator.recovery(RecoverGoal("R1")))
    assert noted == [(0.0, STOP), (0.1, FORWARD), (0.2, FORWARD)]


def test_patience_ends_a_behaviour_that_never_does(bench):
    bench.script.recovery = steps(10 ** 6)
    started = bench.now
    task = bench.navigator.recovery(RecoverGoal("R1"))
    assert bench.finish(task).outcome is RecoveryOutcome.PAT_EXCEEDED and task.ending is Ending.ABORTED
    assert 2.0 < bench.now - started < 2.3 and bench.script.cleaned_up == 1


def test_a_behaviour_that_moves_nothing_is_given_up_as_a_drive_is(make_bench):
    """A car, which cannot turn on the spot, was told to for 15 s each time, and its goal did not end for a minute."""
    bench = make_bench(recovery_patience=60.0, cmd_vel_ignored_tolerance=5.0)
    bench.script.recovery = steps(10 ** 6, Twist2D(0.0, 0.0, 0.4))
    bench.robot.held, started = True, bench.now
    task = bench.navigator.recovery(RecoverGoal("R1"))
    assert bench.finish(task).outcome is RecoveryOutcome.PAT_EXCEEDED and task.ending is Ending.ABORTED
    assert bench.script.cleaned_up == 1 and 5.0 <= bench.now - started < 5.5
    for told in ("'R1'", "stood still for", "0.00 m/s and 0.40 rad/s", "a car, which cannot turn on the spot"):
        assert told in task.result.message


@pytest.mark.parametrize("lose", [
    lambda bench, why: setattr(bench.costmaps["local"], "stale", why),
    lambda bench, why: setattr(bench.robot, "stale", why)], ids=["no scan", "no odometry"])
@pytest.mark.parametrize("drives", [False, True], ids=["recovery", "drive"])
def test_a_robot_that_had_to_stand_as_it_set_out_is_not_said_to_have_ignored_commands(make_bench, lose, drives):
    """The time without a scan counted as if it had been told to move."""
    bench = make_bench(recovery_patience=0.0, controller_patience=0.0, cmd_vel_ignored_tolerance=5.0)
    bench.script.recovery, bench.robot.held = steps(200), True
    goal = FollowGoal(scripted.straight_path()) if drives else RecoverGoal("R1")
    task = (bench.navigator.exe_path if drives else bench.navigator.recovery)(goal)
    bench.run(lambda: bench.robot.sent[-1:] == [FORWARD])
    lose(bench, "3.0 s old")
    for _ in range(80):
        bench.step()
    lose(bench, None)
    for _ in range(3):
        bench.step()
    assert not task.done and bench.robot.sent[-1] == FORWARD
    task.cancel()
    bench.finish(task)


@pytest.mark.parametrize("held, tolerance", [(True, 0.0), (False, 5.0)])
def test_a_behaviour_is_not_given_up_whose_robot_moves_or_whose_user_wants_that(make_bench, held, tolerance):
    bench = make_bench(recovery_patience=60.0, cmd_vel_ignored_tolerance=tolerance)
    bench.script.recovery = steps(100)
    bench.robot.held = held
    assert bench.finish(bench.navigator.recovery(RecoverGoal("R1"))).outcome is RecoveryOutcome.SUCCESS


def test_an_unknown_behaviour_is_rejected(bench):
    task = bench.navigator.recovery(RecoverGoal("dance"))
    assert task.ending is Ending.REJECTED and task.result.outcome is RecoveryOutcome.INVALID_PLUGIN
    assert "R1, R2" in task.result.message


def test_a_newer_goal_replaces_the_running_one(bench):
    bench.script.recovery = steps(1000)
    first = bench.navigator.recovery(RecoverGoal("R1"))
    bench.step()
    bench.script.recovery = steps(2)
    second = bench.navigator.recovery(RecoverGoal("R2"))
    assert first.ending is Ending.CANCELED
    assert bench.finish(second).outcome is RecoveryOutcome.SUCCESS


@pytest.mark.parametrize("pause", [[], [STOP]], ids=["under way", "in a pause of the behaviour's own"])
def test_blind_it_stands_until_it_sees_again(bench, pause):
    bench.script.recovery = lambda context: iter([FORWARD, *pause, *[FORWARD] * 9])
    task = bench.navigator.recovery(RecoverGoal("R1"))
    for _ in [FORWARD, *pause]:
        bench.step()
    bench.costmaps["local"].stale = "source 'scan' is 2 s old"
    for _ in range(3):
        bench.step()
    assert bench.robot.sent == [FORWARD, *pause, STOP, STOP, STOP]
    bench.costmaps["local"].stale = None
    bench.finish(task)
    assert bench.robot.sent.count(FORWARD) == 10


def test_a_robot_whose_pose_fails_for_a_moment_goes_on_recovering(bench):
    """A turn to look round ended at the first pose that a bad radio lost, and the next behaviour was tried."""
    def turning(context):
        for _ in range(10):
            context.pose_in("odom")
            yield Twist2D(0.0, 0.0, 1.0)

    bench.script.recovery = turning
    task = bench.navigator.recovery(RecoverGoal("R1"))
    for _ in range(5):
        bench.step()
    bench.robot.lost = "no transform for a while"
    sent = len(bench.robot.sent)
    for _ in range(6):
        bench.step()
    assert not task.done, task.result
    assert set(bench.robot.sent[sent:]) == {STOP}
    bench.robot.lost = None
    assert bench.finish(task).outcome is RecoveryOutcome.SUCCESS
    assert bench.robot.sent.count(Twist2D(0.0, 0.0, 1.0)) == 10


def test_a_behaviour_that_moves_nothing_needs_no_eyes(bench):
    bench.costmaps["local"].stale = "source 'scan' is 2 s old"
    assert bench.finish(bench.navigator.recovery(RecoverGoal("R1"))).outcome is RecoveryOutcome.SUCCESS


def test_a_behaviour_sees_time_period_and_surroundings(bench):
    seen = []

    def look(context):
        for _ in range(3):
            seen.append((context.now, context.period, context.pose_in("map"), context.velocity))
            yield FORWARD
        assert context.costmaps is bench.costmaps
        assert context.controller.name == "C1"

    bench.script.recovery = look
    assert bench.finish(bench.navigator.recovery(RecoverGoal("R1"))).outcome is RecoveryOutcome.SUCCESS
    assert [round(now - seen[0][0], 6) for now, *_ in seen] == [0.0, 0.1, 0.2]
    assert seen[1][3] == scripted.FORWARD


def test_odometry_that_fails_between_two_looks_is_no_error_of_navigation_s(bench):
    reads = []

    def read_once():
        reads.append(bench.now)
        if len(reads) > 1:
            raise StaleDataError("odometry is 1.00 s old")
        return STOP

    bench.script.recovery = lambda context: iter(())
    bench.robot.velocity = read_once
    assert bench.finish(bench.navigator.recovery(RecoverGoal("R1"))).outcome is RecoveryOutcome.SUCCESS

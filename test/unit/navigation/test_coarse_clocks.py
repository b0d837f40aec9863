"""A robot under a clock that ticks more seldom than its controller is asked to think, as Stage's with its 10 Hz."""

import pytest
from scripted import FORWARD, straight_path

from mbf_relay.navigation.goals import FollowGoal, RecoverGoal


def periods_told(bench, tick, cycles=12):
    """Return the period (s) a controller is told in each cycle of a drive with a step at each tick (s)."""
    told = []
    bench.script.velocity = lambda state: told.append(state.period) or FORWARD
    bench.navigator.exe_path(FollowGoal(straight_path(9.0)))
    bench.run(lambda: len(told) >= cycles, period=tick)
    return told


def test_a_robot_speeds_up_and_brakes_by_the_time_it_really_has_until_the_next_command(make_bench):
    """By half of that it took four times as long to turn round, and reached a goal across the arena in 23 s, not 15."""
    assert periods_told(make_bench(controller_frequency=20.0), 0.1)[2:] == [0.1] * 10
    assert periods_told(make_bench(controller_frequency=50.0), 0.1)[2:] == pytest.approx([0.1] * 10)


@pytest.mark.parametrize("tick", [0.05, 0.02, 1.0 / 60.0])
def test_a_robot_whose_clock_ticks_often_enough_keeps_the_period_asked_for(make_bench, tick):
    assert set(periods_told(make_bench(controller_frequency=20.0), tick)) == {0.05}


def test_one_late_cycle_makes_no_robot_drive_as_if_all_were(make_bench):
    bench = make_bench(controller_frequency=20.0)
    told = periods_told(bench, 0.05)
    bench.step(0.4)
    bench.run(lambda: len(told) >= 20, period=0.05)
    assert set(told) == {0.05}


def test_a_pause_between_two_drives_is_no_period(make_bench):
    bench = make_bench(controller_frequency=20.0)
    for _ in range(4):
        task = bench.navigator.exe_path(FollowGoal(straight_path(9.0)))
        told = []
        bench.script.velocity = lambda state, told=told: told.append(state.period) or FORWARD
        bench.step(0.05)
        task.cancel()
        bench.step(7.0)
        assert told == [0.05]


def test_a_recovery_behaviour_turns_by_the_time_it_really_has(make_bench):
    bench, told = make_bench(controller_frequency=20.0), []

    def turn(context):
        for _ in range(8):
            told.append(context.period)
            yield FORWARD

    bench.script.recovery = turn
    bench.finish(bench.navigator.recovery(RecoverGoal("R1")))
    assert told[2:] == [0.1] * 6

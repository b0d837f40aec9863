"""Stress does to a drive what its name says, the same for the same seed, and nothing where it is not asked to."""

import math

import numpy as np
import pytest
from benchmark.synthetic_drives import Rough, make_drive

from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.replay import errors, replay
from mbf_relay.localization.stress import Stress, parse_stress, spoil, stressed
from mbf_relay.localization.trials import LogTask, Trial, run, summarize_trials, table


@pytest.fixture(scope="module")
def made():
    return make_drive("hall", 40, Rough(beams=60), np.random.default_rng(1))


def harder(made, seed=1, **values):
    return stressed(made.log, made.occupancy, Stress(**values), np.random.default_rng(seed))


def test_without_stress_a_drive_is_as_it_was_recorded(made):
    log, occupancy = harder(made)
    assert np.array_equal(log.odom, made.log.odom) and np.array_equal(log.ranges, made.log.ranges)
    assert np.array_equal(occupancy.data, made.occupancy.data)
    assert str(Stress()) == "as recorded"


def test_blocks_are_taken_out_of_the_map_and_nothing_is_added(made):
    _, occupancy = harder(made, unmapped=0.3)
    before, after = made.occupancy.data >= 65, occupancy.data >= 65
    assert not (after & ~before).any()
    assert 0.4 * before.sum() < after.sum() < 0.95 * before.sum()
    assert (harder(made, unmapped=1.0)[1].data < 65).all()


def test_fewer_scans_and_beams_and_a_shorter_reach(made):
    log, _ = harder(made, every=4, beams=20, range_max=3.0)
    assert log.ranges.shape == (10, 20) and len(log.odom) == len(log.reference) == len(log.times) == 10
    assert log.ranges[:, 5][0] in (made.log.ranges[0, 15], np.inf)
    assert log.scan(0).angles[-1] == pytest.approx(made.log.scan(0).angles[57])
    assert log.range_max == 3.0 and (log.ranges[np.isfinite(log.ranges)] < 3.0).all()


def test_odometry_errs_alike_however_often_it_is_read():
    """A way of 16 m, read in 8 or in 400 steps, ends as far off."""
    spreads = []
    for steps in (8, 400):
        way = np.column_stack((np.linspace(0.0, 16.0, steps + 1), np.zeros((steps + 1, 2))))
        ends = [spoil(way, Stress(odometry=0.05), np.random.default_rng(seed))[-1, 0] for seed in range(300)]
        spreads.append(np.std(ends))
    assert spreads[0] == pytest.approx(0.2, rel=0.2) and spreads[1] == pytest.approx(spreads[0], rel=0.2)


def test_slipping_wheels_count_too_much_and_what_is_no_number_stays_none():
    way = np.column_stack((np.linspace(0.0, 100.0, 201), np.zeros((201, 2))))
    way[50] = math.nan
    slipped = spoil(way, Stress(slips=0.2), np.random.default_rng(1))
    assert np.isnan(slipped[50]).all() and np.isfinite(np.delete(slipped, 50, axis=0)).all()
    assert 102.0 < slipped[-1, 0] < 112.0  # 20 slips of 0.3 m


def test_a_stress_is_told_by_what_it_changes():
    assert str(parse_stress("unmapped=0.3, range_max=3.5")) == "unmapped=0.3 range_max=3.5"
    assert parse_stress("every=3").every == 3
    for wrong in ("unmapped", "=1", "every=0.5", "every=0", "odometry=nan", ""):
        with pytest.raises(ValueError):
            parse_stress(wrong)


def test_logs_without_a_reference_have_no_figures_but_a_row():
    rows = summarize_trials([Trial("drive.npz", "as recorded", 1, None)])
    assert table(rows).splitlines()[1].split() == ["drive.npz", "as", "recorded", "1", "-", "-", "-", "-"]


def test_no_share_s_interval_leaves_0_to_1_and_none_lost_of_three_is_no_proof():
    """Lost was told to be within [-0.242, 0.742], and of three that were found within [0.000, 0.000]."""
    figures = [{"right": right, "median": 0.1, "p95": 0.2, "lost": lost}
               for right, lost in ((1.0, 0.0), (0.99, 0.0), (0.6, 0.0), (0.3, 1.0))]
    some, found = (
        summarize_trials([Trial("drive.npz", "as recorded", seed, each) for seed, each in enumerate(chosen)])[0]
        for chosen in (figures, figures[:3]))
    for row in (some, found):
        assert all(0.0 <= row[name].low <= row[name].value <= row[name].high <= 1.0 for name in ("right", "lost"))
    assert found["lost"].value == 0.0 and found["lost"].high > 0.4


def test_the_trial_of_a_seed_as_recorded_is_the_replay_of_that_seed(made):
    """Whoever replayed the seed that was lost, to see where, saw another drive."""
    task = LogTask("drive.npz", made.log, made.occupancy, None, np.diag([0.25, 0.25, 0.07]))
    trial = next(run(task, LocalizerParameters(), [Stress()], [3]))
    result = replay(
        made.log, made.occupancy, LocalizerParameters(), np.random.default_rng(3), task.start, task.covariance)
    assert trial.figures["median"] == np.median(errors(result.poses, made.log.reference)["translation"])

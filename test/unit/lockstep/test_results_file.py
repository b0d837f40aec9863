"""Results on disk: kills, broken lines, other settings, two writers."""

import dataclasses
import tracemalloc

import numpy as np
import pytest

from mbf_relay.lockstep import results_file
from mbf_relay.lockstep.result import EpisodeResult, failed, score
from mbf_relay.lockstep.results_file import LINES, ResultsFile, read_lines
from mbf_relay.lockstep.smoothness import Smoothness

RESULT = EpisodeResult(
    "barn_001", 3, True, "SUCCEEDED", goals=1, goals_reached=1, time=12.5, smallest_clearance=0.1, score=0.4,
    smoothness=Smoothness(0.5, 0.1), goal_times=(12.5,),
    trajectory=np.array([[0.1, 0.2, 0.3, 0.0, 0.1, 0.2]]), believed=np.array([[0.2, 0.4, 0.1]]),
)


def test_a_line_keeps_everything():
    read = EpisodeResult.from_line(RESULT.to_line())
    assert read == RESULT and read.drive() == RESULT.drive()


def test_a_batch_of_thousands_of_drives_holds_them_all_in_little_memory():
    """Lists of lists of numbers took 0.3 MB a drive: 10 000 drives 3 GB, and to go on with them as much again."""
    rows = np.random.default_rng(1).normal(size=(600, 9)).round(4)
    line = dataclasses.replace(RESULT, trajectory=rows[:, :6], believed=rows[:, 6:]).to_line()
    tracemalloc.start()
    try:
        held = [EpisodeResult.from_line(line) for _ in range(20)]
        taken = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert np.array_equal(held[-1].believed, rows[:, 6:]) and taken < 20 * 1.5 * rows.nbytes


def test_drive_leaves_out_what_the_machine_did():
    other = dataclasses.replace(RESULT, machine={"wall": 3.0}, message="differs")
    assert other.drive() == RESULT.drive()
    assert dataclasses.replace(RESULT, time=12.6).drive() != RESULT.drive()


@pytest.mark.parametrize(
    "text",
    [
        '{"world": "a"}',
        "[1]",
        '{"world": "a", "seed"',
        "null",
        '{"world":"a","seed":1,"success":true,"outcome":"x","smoothness":{"no":1}}',
    ],
)
def test_a_broken_line_says_what_is_wrong(text):
    with pytest.raises(ValueError):
        EpisodeResult.from_line(text)


def test_appended_results_are_found_again(tmp_path):
    file = ResultsFile(tmp_path, {"controller": "dwa"})
    file.append(RESULT)
    file.close()
    again = ResultsFile(tmp_path, {"controller": "dwa"})
    assert again.done == {("barn_001", 3)}
    assert again.results == [RESULT]
    again.close()


def test_a_line_cut_short_by_a_kill_is_left_out_and_the_next_stands_alone(tmp_path):
    file = ResultsFile(tmp_path, {})
    file.append(RESULT)
    file.close()
    with open(tmp_path / LINES, "a", encoding="utf-8") as lines:
        lines.write(failed("barn_002", 3, "x").to_line()[:40])
    file = ResultsFile(tmp_path, {})
    assert file.done == {("barn_001", 3)}
    assert len(file.warnings) == 1 and "line 2" in file.warnings[0]
    file.append(failed("barn_002", 3, "x"))
    file.close()
    results, warnings = read_lines(tmp_path / LINES)
    assert [result.world for result in results] == ["barn_001", "barn_002"]
    assert len(warnings) == 1


def test_an_interrupt_during_the_writing_leaves_no_line_without_its_result(tmp_path, monkeypatch):
    file = ResultsFile(tmp_path, {})

    def interrupt(_descriptor):
        raise KeyboardInterrupt

    monkeypatch.setattr(results_file.os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        file.append(RESULT)
    file.close()
    assert file.results == read_lines(tmp_path / LINES)[0] == [RESULT]


def test_other_settings_are_refused_by_name(tmp_path):
    file = ResultsFile(tmp_path, {"controller": "dwa", "seeds": 1})
    file.append(RESULT)
    file.close()
    with pytest.raises(ValueError, match='controller was "dwa", now "pure_pursuit"'):
        ResultsFile(tmp_path, {"controller": "pure_pursuit", "seeds": 1})


def test_a_batch_that_drove_nothing_leaves_nothing_and_binds_nobody_to_its_settings(tmp_path):
    """After a slip in --scheduler the folder was taken for one of other settings once the slip was mended."""
    kept = tmp_path / "made_before"
    kept.mkdir()
    for folder in (kept, tmp_path / "new"):
        ResultsFile(folder, {"controller": "dwa"}).close()
    assert [path.name for path in tmp_path.rglob("*")] == ["made_before"]


def test_two_batches_do_not_write_to_one_folder(tmp_path):
    first = ResultsFile(tmp_path, {})
    with pytest.raises(ValueError, match="another batch"):
        ResultsFile(tmp_path, {})
    first.close()
    ResultsFile(tmp_path, {}).close()


def test_missing_results_are_named(tmp_path):
    with pytest.raises(ValueError, match="does not exist"):
        read_lines(tmp_path / LINES)


def test_score_is_barns():
    assert score(True, 1.0, 0.44, 0.22) == 0.5
    assert score(True, 10.0, 0.44, 0.22) == pytest.approx(0.2)
    assert score(True, 1000.0, 0.44, 0.22) == 0.125
    assert score(False, 1.0, 0.44, 0.22) == 0.0

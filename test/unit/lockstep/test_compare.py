"""The compare command on folders of results."""

import json

import pytest

from mbf_relay.lockstep import compare
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.results_file import ResultsFile


def batch(folder, times, settings):
    file = ResultsFile(folder, settings)
    for index, time in enumerate(times):
        success = time is not None
        file.append(
            EpisodeResult(f"barn_{index:03d}", 1, success, "SUCCEEDED" if success else "TIMEOUT", time=time or 99.0)
        )
    file.close()
    return folder


def test_differences_and_worlds_that_changed_sides_are_shown(tmp_path, capsys):
    first = batch(tmp_path / "a", [10.0, 20.0, None, 12.0], {"controller": "DWA"})
    second = batch(tmp_path / "b", [9.0, 18.5, 30.0, None], {"controller": "RPP"})
    assert compare.main([str(first), str(second), "--json", str(tmp_path / "c.json")]) == 0
    shown = capsys.readouterr().out
    assert "controller: A 'DWA', B 'RPP'" in shown
    assert "brought to success by B alone: barn_002 (seed 1)" in shown
    assert "brought to success by A alone: barn_003 (seed 1)" in shown
    made = json.loads((tmp_path / "c.json").read_text())
    assert made["measures"]["time of successes"]["difference"][0] == pytest.approx(-1.25)
    assert made["measures"]["score"]["difference"] == [None, None, None]


def test_a_broken_line_is_told_and_left_out(tmp_path, capsys):
    folder = batch(tmp_path / "a", [10.0, 11.0], {})
    with open(folder / "episodes.jsonl", "a") as lines:
        lines.write("{broken\n")
    assert compare.main([str(folder), str(folder)]) == 0
    told = capsys.readouterr()
    assert "line 3, is left out" in told.err
    assert "2 pairs" in told.out and "settings: the same" in told.out


def test_nothing_in_common_and_nothing_there_are_errors(tmp_path, capsys):
    first = batch(tmp_path / "a", [10.0], {})
    second = tmp_path / "b"
    file = ResultsFile(second, {})
    file.append(EpisodeResult("other", 1, True, "SUCCEEDED"))
    file.close()
    assert compare.main([str(first), str(second)]) == 1
    assert "share no world and seed" in capsys.readouterr().err
    assert compare.main([str(first), str(tmp_path / "none")]) == 1
    assert "does not exist" in capsys.readouterr().err

"""The batch command: results, resuming after a kill, interrupts, and what is refused."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("pybullet")
sys.path.insert(0, str(Path(__file__).parent))

import small_worlds  # noqa: E402

from mbf_relay.lockstep import batch  # noqa: E402
from mbf_relay.lockstep.results_file import LINES, read_lines  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]
SCRIPT = ROOT / "scripts" / "batch.py"


def start(*arguments):
    path = os.pathsep.join([str(ROOT / "src"), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, str(SCRIPT), *arguments], env={**os.environ, "PYTHONPATH": path}, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, universal_newlines=True,
    )


def wait_for_lines(path, count, process):
    """Wait until a file has so many lines; fail after a minute."""
    for _ in range(600):
        if path.exists() and len(path.read_text().splitlines()) >= count:
            return
        assert process.poll() is None, process.stderr.read()
        pytest.importorskip("select").select([], [], [], 0.1)
    raise AssertionError(f"waited a minute for {count} lines in {path}")


def test_a_batch_leaves_lines_a_summary_and_pictures(tmp_path, capsys):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE, small_worlds.BLOCKED_START, small_worlds.WALLED_IN)
    assert batch.main([worlds, "--out", str(tmp_path / "out"), "--jobs", "2"]) == 0
    shown = capsys.readouterr()
    assert "blocked_start (seed 1): ERROR" in shown.out and "choose a free place" in shown.out
    results, warnings = read_lines(tmp_path / "out" / LINES)
    assert {result.world: result.success for result in results} == {"free": True, "blocked_start": False, "walled_in": False}
    assert not warnings
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["episodes"] == 3 and summary["success"]["value"] == pytest.approx(1 / 3)
    pictures = {path.name for path in (tmp_path / "out").glob("*.png")}
    assert pictures == {"contact_sheet.png", "failure-walled_in-1.png"}
    assert all((tmp_path / "out" / name).read_bytes().startswith(b"\x89PNG") for name in pictures)


def test_a_killed_batch_goes_on_and_drives_nothing_twice(tmp_path):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE, small_worlds.BENT)
    killed = tmp_path / "killed"
    process = start(worlds, "--out", str(killed), "--seeds", "2", "--jobs", "1")
    wait_for_lines(killed / LINES, 1, process)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    before, _ = read_lines(killed / LINES)
    assert 1 <= len(before) < 4
    assert batch.main([worlds, "--out", str(killed), "--seeds", "2", "--jobs", "2"]) == 0
    assert batch.main([worlds, "--out", str(tmp_path / "whole"), "--seeds", "2", "--jobs", "2"]) == 0
    resumed, _ = read_lines(killed / LINES)
    whole, _ = read_lines(tmp_path / "whole" / LINES)
    assert len((killed / LINES).read_text().splitlines()) == 4
    key = lambda result: (result.world, result.seed)  # noqa: E731
    assert [r.drive() for r in sorted(resumed, key=key)] == [r.drive() for r in sorted(whole, key=key)]


def test_an_interrupt_loses_nothing_that_was_finished(tmp_path):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE, small_worlds.BENT)
    out = tmp_path / "out"
    process = start(worlds, "--out", str(out), "--seeds", "20", "--jobs", "1")
    wait_for_lines(out / LINES, 1, process)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=60)
    assert process.returncode == 130, told
    assert "goes on where this one ended" in told and "Traceback" not in told
    results, warnings = read_lines(out / LINES)
    assert results and not warnings
    assert (out / "summary.json").exists()


def test_a_process_that_dies_is_recorded_and_the_batch_goes_on(tmp_path):
    worlds = load(tmp_path)
    dying = batch.make_setup(batch.config_folder(), has_map=False)
    server = {**dying.settings["move_base_flex"], "controllers": [{"name": "own", "type": "small_worlds.Dying"}]}
    broken = batch.Setup({**dying.settings, "move_base_flex": server}, dying.localization, dying.map)
    results = batch.run([(worlds[0], broken, 1), (worlds[0], dying, 2)], 1)
    assert results[0].outcome == "ERROR" and "exit status 9" in results[0].message
    assert results[1].success


def load(tmp_path):
    return batch.load_tasks(small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE))


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--set", "DWAPlannerROS.sim_tim=2"], "did you mean 'move_base_flex.DWAPlannerROS.sim_time'"),
        (["--set", "sim_time"], "must have the form"),
        (["--controller", "TEB"], "there is no 'TEB' among the controllers"),
        (["--planner", "RRT"], "there is no 'RRT' among the planners"),
        (["--localization", "amcl", "--map", "none"], "amcl needs a map"),
        (["--only", "elsewhere"], "there is no world 'elsewhere'; there are free"),
        (["--set", "DWAPlannerROS.sim_time=-1"], "sim_time is -1"),
    ],
)
def test_what_is_wrong_is_named_before_anything_is_driven(tmp_path, capsys, arguments, words):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE)
    assert batch.main([worlds, "--out", str(tmp_path / "out"), *arguments]) == 1
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out" / LINES).exists()


def test_a_batch_of_one_world_can_be_widened(tmp_path, capsys):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE, small_worlds.BENT)
    assert batch.main([worlds, "--out", str(tmp_path / "out"), "--only", "bent"]) == 0
    assert batch.main([worlds, "--out", str(tmp_path / "out")]) == 0
    assert "1 of 2 episodes have a result already" in capsys.readouterr().err
    assert len((tmp_path / "out" / LINES).read_text().splitlines()) == 2


def test_a_missing_worlds_file_is_named(tmp_path, capsys):
    assert batch.main([str(tmp_path / "none.json"), "--out", str(tmp_path / "out")]) == 1
    assert "none.json cannot be read" in capsys.readouterr().err


def test_changed_parameters_change_the_drive_and_need_another_folder(tmp_path, capsys):
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE)
    assert batch.main([worlds, "--out", str(tmp_path / "a")]) == 0
    slower = ["--set", "DWAPlannerROS.max_vel_x=0.12", "--set", "DWAPlannerROS.max_vel_trans=0.12"]
    assert batch.main([worlds, "--out", str(tmp_path / "b"), *slower]) == 0
    (fast,), (slow,) = (read_lines(tmp_path / name / LINES)[0] for name in ("a", "b"))
    assert slow.success and slow.time > 1.4 * fast.time
    assert batch.main([worlds, "--out", str(tmp_path / "a"), *slower]) == 1
    assert "max_vel_" in capsys.readouterr().err

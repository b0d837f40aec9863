"""Commands whose disk is full say so in a sentence that names the file, and leave what stood there as it was."""

import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from programs import program

from mbf_relay.whole_files import whole_file, write_whole

MAP = Path(__file__).resolve().parents[2] / "config" / "maps" / "turtlebot3_world.yaml"
BEFORE = "what stood here before"


@pytest.fixture
def log(tmp_path):
    path, times = tmp_path / "drive.npz", 0.2 * np.arange(30)
    odom = np.column_stack((0.02 * times, 0.0 * times, 0.0 * times))
    np.savez(path, t=times, odom=odom, ranges=np.full((30, 60), 1.5), angle_min=-3.1, angle_increment=0.1)
    return path


def run_on_full_disk(command, room=0):
    """Run a command that can write files of `room` bytes at most; return its status and what it said of errors."""
    ended = subprocess.run(
        [sys.executable, program(command[0]), *map(str, command[1:])], capture_output=True, text=True, timeout=120.0,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room)),
    )
    return ended.returncode, ended.stderr


@pytest.mark.parametrize("command, named", [
    (["make_worlds.py", "--count", "1", "--out", "{folder}/worlds.json"], "worlds.json"),
    (["world_to_map.py", "arena", "{folder}/arena"], "arena.pgm"),
    (["localize_log.py", "{log}", str(MAP), "--out", "{folder}"], "trajectory.csv"),
], ids=lambda value: value[0] if isinstance(value, list) else None)
def test_whoever_makes_something_on_a_full_disk_is_told_what_was_not_written_and_keeps_what_was(
    command, named, tmp_path, log
):
    folder = tmp_path / "results"
    folder.mkdir()
    (folder / named).write_text(BEFORE)
    status, said = run_on_full_disk([part.format(folder=folder, log=log) for part in command])
    assert status == 1 and said.count("\n") == 1, said
    assert command[0] in said and str(folder / named) in said, said
    assert [path.name for path in folder.iterdir()] == [named] and (folder / named).read_text() == BEFORE


@pytest.mark.parametrize("room", [0, 1 << 13], ids=["from the start", "in the middle"])
def test_whoever_drives_a_batch_on_a_disk_that_is_full_is_told_so_in_a_sentence(room, tmp_path):
    pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")
    worlds, folder = tmp_path / "worlds.json", tmp_path / "batch"
    world = {"name": "near", "start": [0, 0, 0], "goal": [0.5, 0, 0], "goal_radius": 0.15, "time_limit": 10.0}
    worlds.write_text(json.dumps({"worlds": [world]}))
    status, said = run_on_full_disk(["batch.py", worlds, "--jobs", "1", "--seeds", "9", "--out", folder], room)
    assert status == 1 and "Traceback" not in said and "batch.py: " in said and str(folder) in said, said
    again = subprocess.run(
        [sys.executable, program("batch.py"), str(worlds), "--jobs", "1", "--seeds", "9", "--out", str(folder)],
        capture_output=True, text=True, timeout=120.0,
    )
    assert again.returncode == 0 and (folder / "summary.json").exists(), again.stderr


def test_a_file_whose_writer_fails_is_the_one_that_stood_there(tmp_path):
    path = tmp_path / "file"
    write_whole(path, BEFORE)
    with pytest.raises(KeyError), whole_file(path) as stream:
        stream.write(b"half of it")
        raise KeyError
    assert path.read_text() == BEFORE and list(tmp_path.iterdir()) == [path]


def test_a_link_stays_a_link_and_a_pipe_a_pipe(tmp_path):
    real, link = tmp_path / "real", tmp_path / "link"
    link.symlink_to(real)
    write_whole(link, "new")
    assert link.is_symlink() and real.read_text() == "new"
    reading, writing = os.pipe()
    write_whole(f"/proc/self/fd/{writing}", "said")
    assert os.read(reading, 10) == b"said"
    os.close(reading)
    os.close(writing)


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(OSError, match="nowhere/file"):
        write_whole(tmp_path / "nowhere" / "file", "")
    with pytest.raises(OSError, match="/dev/full"):
        write_whole("/dev/full", BEFORE)

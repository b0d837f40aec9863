"""Batches of drives in which something goes wrong from the start, as the simulator's parameters ask for."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("pybullet")
sys.path.insert(0, str(Path(__file__).parent))

import small_worlds  # noqa: E402

from mbf_relay.lockstep.episodes import EpisodeJob, drive  # noqa: E402
from mbf_relay.lockstep.settings import config_folder  # noqa: E402
from mbf_relay.lockstep.setup import TRUTH, make_setup  # noqa: E402
from mbf_relay.lockstep.tasks import load_tasks  # noqa: E402


def setup_with(*changes, **more):
    return make_setup(config_folder(), TRUTH, has_map=False, changes=changes, **more)


def test_a_batch_is_driven_with_the_faults_of_the_simulators_own_file(tmp_path):
    """The node drove with slipping wheels by this file, and a batch with sound ones, as if robots did not mind."""
    (task,) = load_tasks(small_worlds.write(tmp_path / "worlds.json", small_worlds.FREE))
    file = tmp_path / "simulator.yaml"
    file.write_text("faults: {slip: 0.5}\n")
    slipping = setup_with(config=file)
    assert not slipping.notes
    sound, slow = (drive(EpisodeJob(task, setup, 1)) for setup in (setup_with(), slipping))
    assert sound.success and slow.success
    assert slow.time > 1.5 * sound.time
    silent = drive(EpisodeJob(task, setup_with("faults.lidar_silent=true"), 1))
    assert not silent.success and "not ready" in silent.message


def test_a_fault_that_there_is_not_is_told_before_anything_is_driven(tmp_path):
    with pytest.raises(ValueError, match="did you mean 'simulator.faults.odom_jump'"):
        setup_with("simulator.faults.odom_jmp=1.0")
    file = tmp_path / "simulator.yaml"
    file.write_text("faults: {odom_jmp: 1.0}\n")
    (note,) = setup_with(config=file).notes
    assert note.startswith("simulator.faults.odom_jmp: is not known here") and "odom_jump" in note
    file.write_text("faults: 3\n")
    with pytest.raises(ValueError, match="simulator.faults is 3; it must be a group"):
        setup_with(config=file)

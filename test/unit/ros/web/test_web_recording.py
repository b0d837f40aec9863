"""Recordings that somebody started from a browser, and that fail while nobody sees rosbag's own words."""

import os
import shutil
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
from ros_testing import wait_until

from mbf_relay.ros.web.recording import LEAST_SPACE, Recording


@pytest.fixture
def free(monkeypatch):
    """Bytes left on every disk."""
    left = SimpleNamespace(free=LEAST_SPACE)
    monkeypatch.setattr(shutil, "disk_usage", lambda _path: left)
    return left


@pytest.fixture
def recording(tmp_path, free):
    made = Recording(str(tmp_path), 1.0)
    made._command = lambda _namespace: ["sleep", "60"]
    yield made
    made.close()


def test_a_person_who_records_to_a_full_disk_is_told_so_at_once(recording, free):
    free.free = 5000000
    with pytest.raises(OSError, match="has 5 MB left"):
        recording.start("/")
    assert not recording.is_on


def test_a_person_whose_disk_gets_full_is_told_that_no_more_is_recorded(recording, free):
    recording.start("/")
    assert recording.is_on and recording.check() == ""
    free.free -= 1
    assert "MB left" in recording.check()
    assert recording.check() == ""
    recording._process.wait()
    assert not recording.is_on


def test_a_person_whose_disk_was_pulled_out_is_told_so_and_goes_on_seeing_the_robot(recording, monkeypatch):
    recording.start("/")

    def pulled_out(path):
        raise FileNotFoundError(2, "No such file or directory", path)

    monkeypatch.setattr(shutil, "disk_usage", pulled_out)
    assert "is gone" in recording.check()
    assert recording.check() == ""
    recording._process.wait()
    assert not recording.is_on


def test_a_person_whose_recording_died_is_told_so_once(recording):
    recording._command = lambda _namespace: ["false"]
    recording.start("/")
    recording._process.wait()
    assert "failed with status 1" in recording.check()
    assert recording.check() == ""


def test_a_recording_that_somebody_ended_is_no_failure(recording):
    with open(recording.start("/"), "wb"):
        recording.stop()
    assert recording._process.wait() != 0  # sleep's, on an interrupt
    assert not recording.is_on and recording.check() == ""


def test_a_person_who_records_again_while_the_last_bag_is_ending_is_not_told_that_it_is_recorded(recording):
    recording._command = lambda _namespace: ["bash", "-c", "trap '' INT; : > \"$0\"; exec sleep 60", recording.path]
    path = recording.start("/")
    wait_until(lambda: os.path.exists(path), "a process that ends late")
    recording.stop()
    with pytest.raises(OSError, match="still being finished"):
        recording.start("/")
    recording._process.kill()
    recording._process.wait()
    recording._command = lambda _namespace: ["sleep", "60"]
    recording.start("/")
    assert recording.is_on


def test_a_person_who_ends_a_recording_before_it_has_begun_is_told_that_there_is_none(recording):
    recording.start("/")
    recording.stop()
    recording._process.wait()
    assert recording.check().startswith("nothing was recorded")
    assert recording.check() == ""


def test_a_person_who_ends_a_recording_has_a_whole_bag_though_the_node_blocks_signals_in_its_threads(recording):
    """rosbag inherited that: it recorded on, beyond the node's own end, and the bag never got its name."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM})
    try:
        recording.start("/")
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    recording.stop()
    assert recording._process.wait(10.0) == -signal.SIGINT


def test_a_recording_ends_with_a_node_that_is_killed(tmp_path):
    node = subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path)], stdout=subprocess.PIPE)
    bag = int(node.stdout.readline())
    node.kill()
    node.communicate()
    wait_until(lambda: not is_running(bag), "the recording's end", 10.0)


KILLED = """
import sys, time
from mbf_relay.ros.web import recording
recording.LEAST_SPACE = 0
made = recording.Recording(sys.argv[1], 1.0)
made._command = lambda _namespace: ["sleep", "60"]
made.start("/")
print(made._process.pid, flush=True)
time.sleep(60.0)
"""


def is_running(pid):
    """Return whether there is such a process; one that nobody has waited for yet has ended."""
    try:
        with open(f"/proc/{pid}/stat", encoding="ascii") as stat:
            return stat.read().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False

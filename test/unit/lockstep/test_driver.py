"""A driver: work that throws, dies, computes for ever or waits for ever costs itself alone."""

import os
import pickle
import signal
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from odd_work import act  # noqa: E402

import mbf_relay  # noqa: E402
from mbf_relay.lockstep import driver as driver_module  # noqa: E402
from mbf_relay.lockstep.driver import DONE, LOST, THREW, Driver, packed  # noqa: E402
from mbf_relay.lockstep.episodes import Hung, InProcess, Lost  # noqa: E402

PATIENCE = 60.0
"""Seconds a worker gets for a process that hangs, on a machine that is busy."""


@pytest.fixture
def driver():
    made = Driver()
    yield made
    made.end()


def value(answer):
    assert answer[0] == DONE, answer
    return pickle.loads(answer[1])


def test_one_process_does_one_thing_after_another(driver):
    assert value(driver.run(packed(act, 21), 60.0)) == 42
    one = value(driver.run(packed(act, "who"), 60.0))
    assert value(driver.run(packed(act, "who"), 60.0)) == one != os.getpid()
    assert value(driver.run(packed(act, "print"), 60.0)) == "printed", "what is printed is not taken for an answer"
    assert value(driver.run(packed(act, "threads"), 60.0)) == "1"
    assert value(driver.run(packed(act, "x" * 1_000_000), 60.0)) == "x" * 2_000_000


def test_its_process_finds_the_package_where_this_one_does(driver):
    """A built package stands in front of its sources, and has the kernels."""
    assert value(driver.run(packed(act, "package"), 60.0)) == mbf_relay.__file__


def test_what_throws_or_dies_says_so_and_the_next_work_is_done(driver):
    kind, text = driver.run(packed(act, "throw"), 60.0)
    assert kind == THREW and b"ValueError: a plugin's mistake (act, line" in text
    kind, text = driver.run(packed(act, "die"), 60.0)
    assert kind == LOST and b"signal SIGKILL" in text
    assert value(driver.run(packed(act, 2), 60.0)) == 4


def answered(driver, task, limit):
    """Return what a driver answers; a batch whose driver does not would stand still for ever."""
    answers = []
    thread = threading.Thread(target=lambda: answers.append(driver.run(packed(act, task), limit)), daemon=True)
    thread.start()
    thread.join(PATIENCE)
    assert answers, "the worker waits for ever"
    return answers[0]


@pytest.mark.parametrize("task", ["compute", "wait", "send half", "close"])
def test_what_never_ends_is_ended(driver, task):
    kind, text = answered(driver, task, 1.0)
    assert kind == LOST and b"hung: no result within 1 s" in text
    assert value(driver.run(packed(act, 2), 60.0)) == 4


def test_a_process_that_takes_no_work_is_ended(driver):
    value(driver.run(packed(act, 1), 60.0))
    driver._process.send_signal(signal.SIGSTOP)
    kind, text = answered(driver, "x" * 1_000_000, 1.0)
    assert kind == LOST and b"hung: no result within 1 s" in text
    assert value(driver.run(packed(act, 2), 60.0)) == 4


def test_a_process_that_died_is_not_waited_for_while_what_it_started_lives(driver):
    kind, text = answered(driver, "leave a child", 600.0)
    assert kind == LOST and b"the process died (exit status 7)" in text


def hung_after(monkeypatch, step, share, status, limit=900.0):
    """Return after how many seconds of the clock a process counts as hung, None where it may go on for two days.

    Args:
        monkeypatch: Sets what is seen of the process.
        step: Seconds from one look to the next.
        share: Of the clock that it computes.
        status: It is in.
        limit: Its limit of time (s).
    """
    now = [0.0]
    process = SimpleNamespace(
        cpu_times=lambda: SimpleNamespace(user=share * now[0], system=0.0), status=lambda: status)
    monkeypatch.setattr(driver_module.psutil, "Process", lambda pid: process)
    watch = driver_module._Watch(SimpleNamespace(pid=1), limit, lambda: now[0])
    while now[0] < 2 * 86400.0:
        now[0] += step
        try:
            watch.check()
        except driver_module._HungError:
            return now[0]
    return None


def test_a_process_that_only_looks_at_its_watch_is_ended(monkeypatch):
    assert hung_after(monkeypatch, 0.5, 0.0, "sleeping") == pytest.approx(900.0, abs=1.0)
    assert hung_after(monkeypatch, 0.5, 0.002, "sleeping") == pytest.approx(1125.0, abs=2.0)
    assert hung_after(monkeypatch, 0.5, 0.02, "sleeping") == pytest.approx(45000.0, abs=30.0), "by its computing time"


def test_a_process_on_a_busy_machine_or_one_that_slept_has_its_time(monkeypatch):
    assert hung_after(monkeypatch, 0.5, 1e-4, "running") is None, "it waits for a core"
    assert hung_after(monkeypatch, 0.5, 1.0, "running") == pytest.approx(900.0, abs=1.0)
    assert hung_after(monkeypatch, 60.0, 0.0, "sleeping") >= 900 * 60.0, "each look came a minute late"


def test_a_process_that_ended_for_want_of_work_is_no_failure(driver):
    value(driver.run(packed(act, 1), 60.0))
    driver._process.stdin.close()
    driver._process.wait()
    assert value(driver.run(packed(act, 3), 60.0)) == 6


def test_a_process_without_work_ends_quietly_while_its_worker_lives():
    code = "from mbf_relay.lockstep import driver; driver.IDLE = 0.1; driver.main()"
    process = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stderr=subprocess.PIPE)
    with process.stdin, process.stderr:
        assert (process.stderr.read(), process.wait()) == (b"", 0)


def test_work_here_is_interrupted_by_its_own_computing_alone():
    assert list(InProcess().run(act, [1, 2], 60.0)) == [(1, 2), (2, 4)]
    (task, lost), (_, last) = InProcess().run(act, ["compute", 3], 0.2)
    assert task == "compute" and isinstance(lost, Lost) and "hung" in str(lost) and last == 6
    assert not issubclass(Hung, Exception), "a plugin that keeps every exception cannot keep this one"


def test_a_drive_in_ones_own_process_keeps_no_other_core_busy():
    code = (
        "import os, mbf_relay.lockstep, numpy\n"
        "numpy.ones((500, 500)) @ numpy.ones((500, 500))\n"
        "print(len(os.listdir('/proc/self/task')))"
    )
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, stdout=subprocess.PIPE, env=environment, check=True, timeout=60.0)
    assert done.stdout.decode().strip() == "1"

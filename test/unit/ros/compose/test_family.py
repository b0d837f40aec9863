"""A family of processes: what ends is there again, and nobody is left behind."""

import contextlib
import os
import select
import signal
import subprocess
import sys

import psutil
import pytest
from ros_testing import wait_until

PROGRAM = """
import ctypes, os, signal, sys, time, types
from mbf_relay.ros.compose.family import Family

if "emulated" in sys.argv:
    ctypes.CDLL = lambda *_, **__: types.SimpleNamespace(prctl=lambda *_: -1)

def sleep(name):
    os.write(1, f"{name} {os.getpid()}\\n".encode())  # at once: a sibling writes, too
    while True:
        time.sleep(60.0)

def fail():
    sys.exit(3)

def prepare(names):
    if "unprepared" in sys.argv:
        raise MemoryError
    if "slow" in sys.argv:
        time.sleep(60.0)

tasks = {"one": lambda: sleep("one"), "two": lambda: sleep("two")}
if "fail" in sys.argv:
    tasks = {"bad": fail, "good": lambda: None}
sys.exit(Family(prepare, tasks, respawns="respawn" in sys.argv).run())
"""


class Running:
    """The program, and the processes it has told of."""

    def __init__(self, *arguments, terminal=subprocess.DEVNULL, first=None):
        self.process = subprocess.Popen(
            [sys.executable, "-c", PROGRAM, *arguments], stdout=subprocess.PIPE, stderr=terminal, preexec_fn=first)
        self.children = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in (self.process, *self.children):
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()
        self.process.communicate()

    def told(self):
        """Return the next name and process."""
        name, pid = self.process.stdout.readline().split()
        self.children.append(psutil.Process(int(pid)))
        return name.decode(), self.children[-1]


def in_the_background():
    """Do as a shell does to what a script starts with `&`, which a Ctrl-C shall not reach."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def has_ended(process):
    return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE


def test_a_node_that_is_killed_is_there_again_and_its_sibling_drives_on():
    with Running("respawn") as program:
        children = dict(program.told() for _ in range(2))
        children["one"].kill()
        name, successor = program.told()
        assert name == "one" and successor.pid != children["one"].pid
        assert not has_ended(children["two"])


def test_a_node_that_is_killed_is_there_again_though_nobody_reads_what_is_said_of_it():
    reading, writing = os.pipe()
    with open(reading, "rb"), open(writing, "wb") as terminal:
        os.set_blocking(writing, False)
        with pytest.raises(BlockingIOError):
            while True:
                os.write(writing, b"\n" * 4096)
        os.set_blocking(writing, True)
        with Running("respawn", terminal=terminal) as program:
            children = dict(program.told() for _ in range(2))
            children["one"].kill()
            wait_until(lambda: select.select([program.process.stdout], [], [], 0.0)[0], "its successor", 20.0)
            assert program.told()[0] == "one"


def test_who_runs_it_where_no_process_can_adopt_others_reads_that():
    """Under qemu no node was there, and nothing was said of it."""
    with Running("respawn", "emulated", terminal=subprocess.PIPE) as program:
        said = program.process.communicate(timeout=60.0)[1]
    assert program.process.returncode == 1 and b"composed:=false" in said


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("first", [None, in_the_background])
def test_a_signal_ends_all(number, first):
    """In the background of a script roslaunch waited for a quarter of a minute until it sent another one."""
    with Running("respawn", first=first) as program:
        children = [program.told()[1] for _ in range(2)]
        program.process.send_signal(number)
        assert program.process.wait(30.0) == 0
        assert all(has_ended(child) for child in children)


@pytest.mark.parametrize("first", [None, in_the_background])
def test_no_node_outlives_a_parent_that_is_killed(first):
    with Running("respawn", first=first) as program:
        children = [program.told()[1] for _ in range(2)]
        program.process.kill()
        for child in children:
            wait_until(lambda child=child: has_ended(child), "a child to end")


def test_a_child_that_does_not_end_is_killed():
    with Running("respawn") as program:
        children = [program.told()[1] for _ in range(2)]
        os.kill(children[0].pid, signal.SIGSTOP)
        program.process.terminate()
        assert program.process.wait(30.0) == 0
        assert all(has_ended(child) for child in children)


def test_without_respawn_the_end_of_all_is_the_end_and_tells_of_a_failure():
    with Running("fail") as program:
        assert program.process.wait(30.0) == 1


def test_who_prepared_what_the_nodes_share_does_not_stay_and_hold_it_once_more():
    with Running("respawn") as program:
        children = {program.told()[1].pid for _ in range(2)}
        wait_until(
            lambda: {child.pid for child in psutil.Process(program.process.pid).children(recursive=True)} == children,
            "the two nodes to be all there are")


def test_nodes_that_cannot_be_prepared_are_told_of():
    with Running("unprepared") as program:
        assert program.process.wait(30.0) == 1


def test_a_signal_while_they_are_prepared_ends_all():
    with Running("respawn", "slow") as program:
        nursery, = wait_until(
            lambda: psutil.Process(program.process.pid).children(), "somebody to prepare what the nodes share")
        program.process.send_signal(signal.SIGINT)
        assert program.process.wait(30.0) == 0
        assert has_ended(nursery)

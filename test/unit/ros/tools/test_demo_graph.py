"""The demo's hold on its processes."""

import importlib.metadata
import math
import os
import signal
import subprocess
import sys
import time

import pytest
from ros_testing import wait_until

from mbf_relay.ros.tools.demo import parse, versions

PARENT_THAT_DIES = """
import os, subprocess, sys
from mbf_relay.ros.tools import demo_graph
demo_graph.adopt_orphans()
code = "import subprocess; print(subprocess.Popen(['sleep', '600'], stdout=subprocess.DEVNULL).pid, flush=True)"
parent = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, universal_newlines=True)
orphan = int(parent.stdout)
assert demo_graph.descendants(os.getpid()) == [orphan]
demo_graph.kill_descendants()
assert demo_graph.descendants(os.getpid()) == []
try:
    os.kill(orphan, 0)
except ProcessLookupError:
    print("gone")
"""

RECORDER = """
from types import SimpleNamespace
from mbf_relay.ros.tools import demo
import rospy

def init_node(*_, **__):
    from rospy.impl.masterslave import ROSHandler
    raise SystemExit(ROSHandler._connect_topic.__module__)

rospy.init_node = init_node
demo.watch(SimpleNamespace(environment={}), SimpleNamespace(), "")
"""


def test_a_demo_does_not_miss_the_topics_that_rospy_fails_to_connect():
    """Its report lacked the robot's poses."""
    run = subprocess.run([sys.executable, "-c", RECORDER], stderr=subprocess.PIPE, text=True)
    assert run.stderr.endswith("rospy_patches.connecting\n")


def test_a_process_whose_parent_died_is_found_and_ended():
    run = subprocess.run([sys.executable, "-c", PARENT_THAT_DIES], stdout=subprocess.PIPE, text=True)
    assert run.stdout == "gone\n" and run.returncode == 0


def test_a_request_to_end_waits_for_the_block():
    from mbf_relay.ros.tools.demo_graph import uninterrupted

    steps, before = [], signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt), uninterrupted():
        signal.raise_signal(signal.SIGINT)
        steps.append("finished")
    assert steps == ["finished"]
    assert signal.getsignal(signal.SIGINT) is before


def test_an_interrupt_while_the_graph_starts_leaves_no_process(tmp_path):
    from mbf_relay.ros.tools.demo_graph import DemoGraph

    class Interrupted(DemoGraph):
        """A graph whose process is interrupted the moment it runs."""

        def start(self, command, log):
            super().start(["sleep", "600"], log)
            raise KeyboardInterrupt

    graph = Interrupted(["mbf_relay", "demo.launch"], str(tmp_path))
    with pytest.raises(KeyboardInterrupt), graph:
        pytest.fail("it went on after an interrupt")
    assert [process.poll() is not None for process in graph._processes] == [True]


def test_a_second_interrupt_does_not_keep_the_first_from_ending_everything(tmp_path, monkeypatch):
    from mbf_relay.ros.tools import demo_graph

    begin = demo_graph.uninterrupted

    def interrupted_again():
        signal.raise_signal(signal.SIGINT)
        return begin()

    before = {number: signal.getsignal(number) for number in demo_graph.ENDING_SIGNALS}
    graph = demo_graph.DemoGraph(["mbf_relay", "demo.launch"], str(tmp_path))
    graph._command = ["sleep", "600"]
    try:
        demo_graph.end_on_request()
        with pytest.raises(KeyboardInterrupt), graph:
            monkeypatch.setattr(demo_graph, "uninterrupted", interrupted_again)
            signal.raise_signal(signal.SIGINT)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert [process.poll() is not None for process in graph._processes] == [True]


def test_complaints_come_before_the_last_lines(tmp_path):
    from mbf_relay.ros.tools.demo_graph import last_errors

    log = tmp_path / "log"
    log.write_text("one\n[FATAL] the map is missing\ntwo\n\n")
    assert last_errors(str(log)) == "[FATAL] the map is missing"
    log.write_text("one\ntwo\n")
    assert last_errors(str(log)) == "one\ntwo"


def test_the_relay_s_reasons_are_found_in_the_log_of_the_nodes(tmp_path):
    from mbf_relay.ros.tools.demo import reasons_of_aborts

    log = tmp_path / "roslaunch.log"
    log.write_text(
        "[INFO] [1.0, 2.0]: goal /client-1 ended: SUCCESS: fine\n"
        "\x1b[33m[WARN] [1.5, 3.0]: goal /client-2 aborted: ExePath TF_ERROR: the transform is 2.07 s old\x1b[0m\n"
        "\x1b[33m[WARN] [1.5, 3.0]: move_base aborted: the transform is 2.07 s old\x1b[0m\n"
    )
    assert reasons_of_aborts(str(log)) == ["ExePath TF_ERROR: the transform is 2.07 s old"]


def test_a_report_is_written_where_kernels_came_compiled_and_numba_is_not_installed(monkeypatch):
    def none(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "version", none)
    assert versions()["numba"] == "not installed"


def test_nobody_waits_at_the_end_of_a_drive_for_libraries_that_are_only_named():
    code = (
        "import sys; from mbf_relay.ros.tools.demo import versions; found = versions(); "
        "print(found['numpy'][0].isdigit(), {'numba', 'scipy', 'matplotlib', 'cv2'} & set(sys.modules))")
    done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, check=True, timeout=60.0)
    assert done.stdout.decode().strip() == "True set()"


STARTS_NODES = """
import signal, subprocess, sys, time
signal.signal(signal.SIGINT, lambda *_: sys.exit(3))  # in the middle of a start, where roslaunch hangs
nodes = []
for _ in range(5):
    nodes.append(subprocess.Popen(["sleep", "600"], stdout=subprocess.DEVNULL))
    time.sleep(0.1)
signal.signal(signal.SIGINT, lambda *_: [node.kill() for node in nodes] + [sys.exit(0)])
while True:
    signal.pause()
"""


def test_whoever_interrupts_while_nodes_start_does_not_wait_for_a_roslaunch_that_hangs(tmp_path, monkeypatch):
    """It takes the signal with a lock held that its own ending waits for, and gave up after 20 s."""
    from mbf_relay.ros.tools import demo_graph
    from mbf_relay.ros.tools.demo_graph import DemoGraph, descendants

    monkeypatch.setattr(demo_graph, "STARTED", 3.0)  # on a busy machine the next node may come late
    monkeypatch.setattr(demo_graph, "STARTING", 60.0)

    class Starting(DemoGraph):
        """A graph whose process starts nodes one after the other."""

        def start(self, command, log):
            return super().start([sys.executable, "-c", STARTS_NODES], log)

    with Starting(["mbf_relay", "demo.launch"], str(tmp_path)) as graph:
        wait_until(lambda: descendants(graph._processes[0].pid), "the first node")
    assert graph._processes[0].returncode == 0


def test_a_node_is_as_young_as_it_is_whenever_the_machine_was_booted():
    """It counted as up to a second older: on some machines every interrupt at the start took 20 s."""
    from mbf_relay.ros.tools.demo_graph import age_of

    def now():
        return time.clock_gettime(time.CLOCK_BOOTTIME)

    before, tick = now(), 1.0 / os.sysconf("SC_CLK_TCK")
    node = subprocess.Popen(["sleep", "600"])
    try:
        started = now()
        age, after = age_of(node.pid), now()
        assert -tick < age < after - before + tick
        assert now() - started - tick < age_of(node.pid)
    finally:
        node.kill()
        node.wait()
    assert age_of(node.pid) == math.inf


@pytest.mark.parametrize("seed", ["-1", "3000000000"])
def test_a_seed_that_no_parameter_holds_is_refused_at_once(seed, capsys):
    """It started roslaunch, which ended with an OverflowError's last lines."""
    with pytest.raises(SystemExit):
        parse(["--no-rviz", "--seed", seed])
    assert f"--seed is {seed}; it must be 0 to 2147483647" in capsys.readouterr().err

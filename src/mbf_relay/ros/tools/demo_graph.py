"""The demo's processes: a roslaunch with its own master, and a client; all are ended with the demo."""

from __future__ import annotations

import contextlib
import math
import os
import random
import signal
import socket
import subprocess
import time
import xmlrpc.client  # nosec B411: what the ROS master speaks
from typing import Any, Dict, Iterator, List, Tuple, cast

import psutil

from mbf_relay.ros.common.ending import adopt_orphans, interrupt_at_death_of

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
INTERRUPT_PATIENCE = 25.0
"""Wall time (s) for roslaunch to end its nodes; it waits 15 s for each before it sends SIGTERM."""
STARTED, STARTING = 0.5, 5.0
"""Wall times (s): without a new node, after which roslaunch counts as done; and the longest wait for that."""

LOOPBACK = "127.0.0.1"
PORTS = (15000, 32000)
"""Range of TCP ports from which a free one is chosen."""


class GraphError(Exception):
    """The graph did not start, or ended; the text says why as far as known."""


class DemoGraph:
    """A context manager that runs a launch file with a master on a free port, and ends all its processes.

    Args:
        launch: Package, launch file and arguments, as for roslaunch.
        folder: Folder of the logs.
    """

    def __init__(self, launch: List[str], folder: str) -> None:
        self._log = os.path.join(folder, "roslaunch.log")
        self._processes: List[subprocess.Popen] = []
        port = free_port()
        # With this address ROS listens on the loopback interface only; ROS_HOSTNAME would override it.
        self.environment: Dict[str, str] = dict(
            os.environ, ROS_MASTER_URI=f"http://{LOOPBACK}:{port}", ROS_IP=LOOPBACK, ROS_LOG_DIR=folder,
        )
        self.environment.pop("ROS_HOSTNAME", None)
        self._command = ["roslaunch", "-p", str(port)] + launch

    def __enter__(self) -> DemoGraph:
        adopt_orphans()
        os.makedirs(os.path.dirname(self._log), exist_ok=True)
        try:
            self.start(self._command, self._log)
        except BaseException:  # an interrupt deferred until it had started: __exit__ is not called then
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        with uninterrupted():
            for process in reversed(self._processes):
                if process is self._processes[0]:
                    let_start(process)
                end(process)
            kill_descendants()

    def start(self, command: List[str], log: str) -> subprocess.Popen:
        """Start a process with its output in the file `log`, in its own session, so that Ctrl-C does not reach it."""
        with open(log, "wb") as stream, uninterrupted():
            process = subprocess.Popen(
                command, env=self.environment, stdin=subprocess.DEVNULL, stdout=stream, stderr=subprocess.STDOUT,
                start_new_session=True, preexec_fn=interrupt_at_death_of(os.getpid()),
            )
            self._processes.append(process)
        return process

    def check(self) -> None:
        """Raise GraphError where roslaunch has ended, as it does when a required node ends."""
        if self._processes[0].poll() is not None:
            raise GraphError(f"the nodes have ended:\n{last_errors(self._log)}\nAll of it: {self._log}")

    def wait_for_parameter(self, name: str, timeout: float) -> None:
        """Wait until the master has a parameter; roslaunch sets them before it starts nodes.

        Raises:
            GraphError: It is not set within `timeout` (s, wall time), or roslaunch ended.
        """
        master = xmlrpc.client.ServerProxy(self.environment["ROS_MASTER_URI"])
        end_time = time.monotonic() + timeout
        while time.monotonic() < end_time:
            self.check()
            try:
                _code, _text, there = cast("Tuple[int, str, bool]", master.hasParam("/demo", name))
                if there:
                    return
            except (OSError, xmlrpc.client.Error):
                pass
            time.sleep(0.05)
        raise GraphError(f"roslaunch did not set {name} within {timeout:.0f} s; see {self._log}")


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Defer SIGINT, SIGTERM and SIGHUP to the end of the block, so that each process started is registered."""
    pending: List[signal.Signals] = []
    before = {
        number: signal.signal(number, lambda n, _: pending.append(signal.Signals(n))) for number in ENDING_SIGNALS
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if pending:
        handler = before[pending[0]]
        if not callable(handler):
            raise KeyboardInterrupt
        handler(pending[0], None)


def end_on_request() -> None:
    """Raise KeyboardInterrupt on the first of ENDING_SIGNALS; ignore later ones, which would interrupt the clean-up."""
    for number in ENDING_SIGNALS:
        signal.signal(number, _interrupt)


def _interrupt(_number: int, _frame: Any) -> None:
    for number in ENDING_SIGNALS:
        signal.signal(number, lambda _number, _frame: None)
    raise KeyboardInterrupt


def free_port() -> int:
    """Return a free TCP port, so that a running master is not disturbed.

    It is below the ephemeral ports (from 32768 on): otherwise a node that tries to reach a master that is being
    restarted could be given the master's port for its own connection, and keep it.
    """
    for port in random.SystemRandom().sample(range(*PORTS), 100):
        with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
            try:
                probe.bind((LOOPBACK, port))
            except OSError:
                continue
            return port
    raise GraphError(f"none of 100 TCP ports from {PORTS[0]} to {PORTS[1]} is free")


def let_start(roslaunch: subprocess.Popen) -> None:
    """Wait while roslaunch starts nodes: interrupted then, it would wait 20 s for a lock that it holds itself."""
    deadline = time.monotonic() + STARTING
    while roslaunch.poll() is None and time.monotonic() < deadline and starts_nodes(roslaunch.pid):
        time.sleep(0.05)


def starts_nodes(pid: int) -> bool:
    """Return whether a process has started a child within the last STARTED seconds."""
    try:
        return any(age_of(child.pid) < STARTED for child in psutil.Process(pid).children())
    except psutil.NoSuchProcess:
        return False


def age_of(pid: int) -> float:
    """Return for how long (s) a process has been there; infinite of one that has ended.

    By the kernel's own clock: the time of day that psutil has for a start is up to a second too early, since of that at
    which the machine was booted only whole seconds are told.
    """
    try:
        with open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as stream:
            ticks = int(stream.read().rpartition(")")[2].split()[19])  # starttime of proc(5)
    except OSError:
        return math.inf
    return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")


def end(process: subprocess.Popen) -> None:
    """End a process by SIGINT, on which roslaunch ends its nodes, and by SIGKILL after INTERRUPT_PATIENCE (s)."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(INTERRUPT_PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def kill_descendants() -> None:
    """Kill all remaining descendants of this process; a roslaunch interrupted early may leave a node behind."""
    while True:
        left = descendants(os.getpid())
        if not left:
            return
        for pid in left:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        try:
            os.waitpid(-1, 0)
        except ChildProcessError:
            return


def descendants(pid: int) -> List[int]:
    """Return the PIDs of all descendants of a process."""
    try:
        return [process.pid for process in psutil.Process(pid).children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


def last_errors(log: str) -> str:
    """Return the last eight lines of a log with errors, else its last eight lines."""
    with open(log, encoding="utf-8", errors="replace") as stream:
        lines = [line.rstrip() for line in stream if line.strip()]
    errors = [line for line in lines if any(word in line for word in ("FATAL", "ERROR", "Error", "REQUIRED"))]
    return "\n".join((errors or lines)[-8:])

"""The demo's processes: a roslaunch with a master of its own, and a client; all of them gone in the end."""

from __future__ import annotations

import contextlib
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
"""Wall seconds roslaunch gets to end its nodes; it gives each 15 s before it turns to SIGTERM."""
STARTED, STARTING = 0.5, 5.0
"""Wall seconds without a new node after which roslaunch has started all, and for which it may go on starting some."""

LOOPBACK = "127.0.0.1"
PORTS = (15000, 32000)
"""TCP ports among which a free one is looked for."""


class GraphError(Exception):
    """The graph did not come up or went down; the text says what is known."""


class DemoGraph:
    """A context manager that runs a launch file on a free port and ends whatever came of it.

    Args:
        launch: Package, launch file and arguments, as for roslaunch.
        folder: Where logs go.
    """

    def __init__(self, launch: List[str], folder: str) -> None:
        self._log = os.path.join(folder, "roslaunch.log")
        self._processes: List[subprocess.Popen] = []
        port = free_port()
        # With this address everything of ROS listens on the loopback interface alone; a host name would win over it.
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
        except BaseException:  # an interrupt put off until it had started: nobody else would end it
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
        """Start a process of the graph, its output in the file `log`; Ctrl-C in the terminal does not reach it."""
        with open(log, "wb") as stream, uninterrupted():
            process = subprocess.Popen(
                command, env=self.environment, stdin=subprocess.DEVNULL, stdout=stream, stderr=subprocess.STDOUT,
                start_new_session=True, preexec_fn=interrupt_at_death_of(os.getpid()),
            )
            self._processes.append(process)
        return process

    def check(self) -> None:
        """Raise GraphError where roslaunch has ended, as it does when a required node dies."""
        if self._processes[0].poll() is not None:
            raise GraphError(f"the nodes have ended:\n{last_errors(self._log)}\nAll of it: {self._log}")

    def wait_for_parameter(self, name: str, timeout: float) -> None:
        """Return once the master has a parameter, which roslaunch sets before it starts nodes.

        Raises:
            GraphError: It has none after `timeout` wall seconds, or roslaunch ended.
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
    """Put off requests to end until the block is done, where a process started must not be lost sight of."""
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
    """Take the first request to end for a KeyboardInterrupt, and no other: it would interrupt the ending."""
    for number in ENDING_SIGNALS:
        signal.signal(number, _interrupt)


def _interrupt(_number: int, _frame: Any) -> None:
    for number in ENDING_SIGNALS:
        signal.signal(number, lambda _number, _frame: None)
    raise KeyboardInterrupt


def free_port() -> int:
    """Return a TCP port nobody listens on, so that a master that runs is left alone.

    It is none of those that systems give to connections (from 32768 on): between a master's death and its successor's
    start a node that looks for it could be given its port, and keep it.
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
    """Wait while roslaunch starts nodes: it hears a signal with a lock held that its own ending waits for, for 20 s."""
    deadline = time.monotonic() + STARTING
    while roslaunch.poll() is None and time.monotonic() < deadline and starts_nodes(roslaunch.pid):
        time.sleep(0.05)


def starts_nodes(pid: int) -> bool:
    """Return whether a process has started another one a moment ago."""
    try:
        return any(time.time() - child.create_time() < STARTED for child in psutil.Process(pid).children())
    except psutil.NoSuchProcess:
        return False


def end(process: subprocess.Popen) -> None:
    """End a process with SIGINT, on which roslaunch ends its nodes, or with SIGKILL if it stays."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(INTERRUPT_PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def kill_descendants() -> None:
    """Kill whatever this process's children left behind; a roslaunch interrupted early may leave a node."""
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
    """Return the processes that `pid` started, and those they started in turn."""
    try:
        return [process.pid for process in psutil.Process(pid).children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


def last_errors(log: str) -> str:
    """Return the last eight lines of a log that say what went wrong, else its last lines."""
    with open(log, encoding="utf-8", errors="replace") as stream:
        lines = [line.rstrip() for line in stream if line.strip()]
    errors = [line for line in lines if any(word in line for word in ("FATAL", "ERROR", "Error", "REQUIRED"))]
    return "\n".join((errors or lines)[-8:])

"""Runs pieces of work in a subprocess that is monitored, so that a crash or hang costs one result and not the worker.

The work runs plugins and a physics engine, which may raise, crash, exhaust the memory or never end. The worker sends
the work as bytes and gets bytes back, or the reason why the work was lost; the next piece then gets a new subprocess. A
worker needs this module alone; what the work needs is imported in the subprocess.
"""

from __future__ import annotations

import contextlib
import os
import pickle  # nosec B403
import queue
import select
import signal
import struct
import subprocess
import sys
import threading
import time
import traceback
from typing import IO, BinaryIO, Callable, List, Optional, Tuple, cast

import psutil

import mbf_relay

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment that gives each process one thread: more would compete for the cores, and sum in an order that varies."""
DONE, THREW, REFUSED, LOST = b"done", b"threw", b"refused", b"lost"
"""Kinds of answers: the work returned, it raised, the process has other sources, the process hung or died."""
IDLE = 60.0
"""Seconds without work after which the process ends; it ends at once where its worker is gone."""
LOOK = 0.5
"""Seconds between two checks of the process' CPU time."""
HEAD = struct.Struct("<Q")
"""Header of each message: its length in bytes."""
PIECE = 1 << 16
"""Bytes written or read at once: the capacity of a pipe."""
PAID = 100.0
"""Seconds of idle time that one second of CPU time makes up for. A process that waits for something and polls now and
then uses some CPU time, but less than that, and is found hanging."""
ENDING = 10.0
"""Seconds to wait for a killed process. One that hangs in the kernel (a network share that is gone) is left behind."""

Answer = Tuple[bytes, bytes]
"""The kind of answer, and its content: the pickled value for DONE, else a text."""


class Driver:
    """The subprocess of a worker, started with the first work; used by one thread at a time."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Start nothing yet.

        Args:
            clock: Gives the time (s).
        """
        self._clock = clock
        self._process: Optional[subprocess.Popen] = None

    def run(self, work: bytes, time_limit: float) -> Answer:
        """Run a piece of work in the process and return the answer.

        Where the process has other sources than the work expects, they may have been edited since it started: a new
        process is tried once before the work is refused.

        Args:
            work: See `packed`.
            time_limit: Seconds of CPU time after which the process counts as hung; also seconds of idle time, in which
                it hardly computes and does not wait for a core either.
        """
        for _ in range(2):
            is_new = not self._is_there()
            process = self._started()
            try:
                content = self._exchanged(process, _framed(work), time_limit)
            except _HungError:
                self.end()
                return LOST, f"hung: no result within {time_limit:g} s of computing".encode()
            if content is not None:
                # trusted: written by our own subprocess
                answer: Answer = pickle.loads(content)  # noqa: S301  # nosec B301
                if answer[0] != REFUSED or is_new:
                    return answer
                self.end()
                continue
            code = process.returncode
            self.end()
            if code:  # else it ended for lack of work (IDLE) just now
                return LOST, f"the process died ({_how_it_died(code)})".encode()
        return LOST, b"the process ended without a result"

    def end(self) -> None:
        """Kill the process."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(ENDING)
            for pipe in (process.stdin, process.stdout):
                _pipe(pipe).close()

    def _is_there(self) -> bool:
        return self._process is not None and self._process.poll() is None

    def _started(self) -> subprocess.Popen:
        if not self._is_there():
            self.end()
        if self._process is None:
            environment = {**os.environ, **ONE_THREAD, "PYTHONPATH": os.pathsep.join(filter(None, path_of_processes()))}
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment,
                bufsize=0,
            )
            for pipe in (self._process.stdin, self._process.stdout):
                os.set_blocking(_pipe(pipe).fileno(), False)
        return self._process

    def _exchanged(self, process: subprocess.Popen, work: bytes, time_limit: float) -> Optional[bytes]:
        """Send work and return the process' answer, None if it ended without one; raise _HungError if it hangs.

        No call here blocks for longer than LOOK, whatever the process does with its pipes.
        """
        watch = _Watch(process, time_limit, self._clock)
        sends, reads = _pipe(process.stdin), _pipe(process.stdout)
        left, came, talks = memoryview(work), bytearray(), True
        while True:
            if talks:
                ready = select.select([reads], [sends] if left else [], [], LOOK)
            else:  # it closed its output, as it does when it ends
                with contextlib.suppress(subprocess.TimeoutExpired):
                    process.wait(LOOK)
                ready = [], [], []
            if ready[1]:
                left = _sent(sends, left)
            if ready[0]:
                piece = reads.read(PIECE) or b""
                came += piece
                talks = bool(piece)
            if len(came) >= HEAD.size and len(came) - HEAD.size >= HEAD.unpack_from(came)[0]:
                return bytes(memoryview(came)[HEAD.size:])
            if not any(ready) and process.poll() is not None:
                return None
            watch.check()


class _HungError(Exception):
    """A process has used up its time without a result."""


class _Watch:
    """Measures a process' CPU time and idle time against a limit (s)."""

    def __init__(self, process: subprocess.Popen, time_limit: float, clock: Callable[[], float]) -> None:
        self._process, self._time_limit, self._clock = psutil.Process(process.pid), time_limit, clock
        self._used = self._idle = 0.0
        self._begin = self._used = self._computed()
        self._looked = clock()

    def check(self) -> None:
        """Check the process, at most every LOOK; raise _HungError where its CPU time or idle time exceeds the limit."""
        now = self._clock()
        if now - self._looked < LOOK:
            return
        computed, before = self._computed(), self._used
        # A check that comes late, after the machine was suspended or busy, counts as two periods at most.
        waited = 0.0 if self._runs() else min(now - self._looked, 2.0 * LOOK)
        self._used, self._looked = computed, now
        self._idle = max(0.0, self._idle + waited - PAID * (computed - before))
        if computed - self._begin > self._time_limit or self._idle > self._time_limit:
            raise _HungError

    def _computed(self) -> float:
        """Return the CPU time (s) of the process so far."""
        with contextlib.suppress(psutil.Error):
            times = self._process.cpu_times()
            return float(times.user + times.system)
        return self._used

    def _runs(self) -> bool:
        """Return whether the process is running or waiting for a core."""
        with contextlib.suppress(psutil.Error):
            return bool(self._process.status() == psutil.STATUS_RUNNING)
        return False


def path_of_processes() -> List[str]:
    """Return sys.path for subprocesses, with the folder in front from which this package was imported.

    That may be a build's package, which has the compiled kernels, and which itself puts the source folder, without
    kernels, in front of sys.path.
    """
    return [os.path.dirname(os.path.dirname(mbf_relay.__file__)), *sys.path]


def packed(call: Callable, argument: object, expected: object = None) -> bytes:
    """Return work as bytes for a driver.

    Args:
        call: A function at the top level of a module, which is pickled by name.
        argument: Its argument.
        expected: The Sources that the process must have; not checked where None.
    """
    return pickle.dumps((expected, call, argument), protocol=4)


def run_on_worker(work: bytes, time_limit: float) -> Answer:
    """Run a piece of work in this thread's driver, which is made at its first call; see `Driver.run`."""
    driver = getattr(_of_thread, "driver", None)
    if driver is None:
        driver = _of_thread.driver = Driver()
        _drivers.append(driver)
    return driver.run(work, time_limit)


def end_all() -> None:
    """Kill the subprocesses of all drivers."""
    for driver in _drivers:
        driver.end()


_of_thread = threading.local()
_drivers: List[Driver] = []


def main() -> None:
    """Run the subprocess: read work from stdin and write answers to stdout, until there is no work for IDLE."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a Ctrl-C reaches the whole process group; the client handles it
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what plugins print goes to stderr
    waiting: queue.Queue = queue.Queue()
    threading.Thread(target=_take, args=(sys.stdin.buffer, waiting), daemon=True).start()
    while True:
        try:
            work = waiting.get(timeout=IDLE)
        except queue.Empty:
            os._exit(0)  # sys.exit would abort, as the reading thread holds stdin's lock
        answers.write(_framed(pickle.dumps(answer(work), protocol=4)))
        answers.flush()


def answer(work: bytes) -> Answer:
    """Run a piece of work in this process and return the answer."""
    try:
        # trusted: written by our own worker
        expected, call, argument = pickle.loads(work)  # noqa: S301  # nosec B301
        if expected is not None:
            from mbf_relay.lockstep.sources import sources

            difference = expected.difference(sources(sorted(expected.plugins)))
            if difference:
                return REFUSED, difference.encode()
        return DONE, pickle.dumps(call(argument), protocol=4)
    except Exception as error:  # whatever a plugin throws must not end the batch
        from mbf_relay.plugins import PluginFailure

        if isinstance(error, PluginFailure):  # its text names file and line
            return THREW, str(error).encode()
        last = traceback.extract_tb(error.__traceback__)[-1]
        return THREW, f"{type(error).__name__}: {error} ({last.name}, line {last.lineno})".encode()


def _take(stream: BinaryIO, waiting: queue.Queue) -> None:
    """Read work into a queue; exit the process when the worker closes the pipe."""
    try:
        while True:
            waiting.put(_receive(stream))
    except (EOFError, OSError):
        os._exit(0)


def _framed(content: bytes) -> bytes:
    return HEAD.pack(len(content)) + content


def _sent(stream: BinaryIO, content: memoryview) -> memoryview:
    """Write what the pipe accepts without blocking; return the rest, which is empty where nobody reads any more."""
    try:
        return content[stream.write(content[:PIECE]) or 0:]
    except BrokenPipeError:
        return content[:0]


def _receive(stream: BinaryIO) -> bytes:
    (length,) = HEAD.unpack(_exactly(stream, HEAD.size))
    return _exactly(stream, length)


def _exactly(stream: BinaryIO, count: int) -> bytes:
    content = stream.read(count)
    if len(content) < count:
        raise EOFError
    return content


def _pipe(stream: Optional[IO[bytes]]) -> BinaryIO:
    assert stream is not None
    return cast(BinaryIO, stream)


def _how_it_died(code: int) -> str:
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit status {code}"


if __name__ == "__main__":
    main()

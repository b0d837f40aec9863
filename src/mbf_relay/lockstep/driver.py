"""A process beside a worker that does one piece of work after another and is watched meanwhile.

What it does comes from plugins and a physics engine, so it may throw, crash, exhaust the memory or never end. None of
that reaches the worker: it sends bytes, gets bytes back or an account of how the work was lost, and starts another
process for the next piece. A worker needs this module alone; what the work needs is imported in the process.
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
"""Each process gets one core: threads of libraries would fight over them, and add up in an order of their own."""
DONE, THREW, REFUSED, LOST = b"done", b"threw", b"refused", b"lost"
"""What became of a piece of work; what is sent with it is a pickled value, or a text."""
IDLE = 60.0
"""Seconds without work after which the process ends; so does one whose worker is gone, at once."""
LOOK = 0.5
"""Seconds between two looks at whether the process still computes."""
HEAD = struct.Struct("<Q")
"""What goes before each message: its length."""
PIECE = 1 << 16
"""Bytes written or read at once; as many as a pipe holds."""
PAID = 100.0
"""Seconds of the clock without computing that a second of computing pays for: one that waits and only looks at its
watch now and then does not compute, and no piece of work, whatever it does, lasts for ever."""
ENDING = 10.0
"""Seconds for a killed process to be gone. One that hangs in the kernel (a share of a network that went) is left."""

Answer = Tuple[bytes, bytes]


class Driver:
    """A process that works, as seen from its worker; used by one thread at a time."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """Make none yet; it starts with the first work.

        Args:
            clock: Tells the time (s).
        """
        self._clock = clock
        self._process: Optional[subprocess.Popen] = None

    def run(self, work: bytes, time_limit: float) -> Answer:
        """Return what became of a piece of work.

        A process that has other sources than the work must be of is ended, for it may have loaded them before they were
        edited; the next one refuses the work only where they are others still.

        Args:
            work: See `packed`.
            time_limit: Seconds of computing time after which it counts as hung; so it does after as many seconds of
                the clock in which it next to never computed, nor waited for a core to do so.
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
                # of our own process, not from outside
                answer: Answer = pickle.loads(content)  # noqa: S301  # nosec B301
                if answer[0] != REFUSED or is_new:
                    return answer
                self.end()
                continue
            code = process.returncode
            self.end()
            if code:  # else it had been without work and just ended
                return LOST, f"the process died ({_how_it_died(code)})".encode()
        return LOST, b"the process ended without a result"

    def end(self) -> None:
        """End the process, whatever it does."""
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
        """Send work and return what comes back, None of a process that ended before; raise _HungError in the end.

        Nothing here waits for the process for longer than from one look at it to the next, whatever it reads, sends,
        closes or leaves.
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
            watch.look()


class _HungError(Exception):
    """A process got the time it may take, and gave no result."""


class _Watch:
    """Looks at whether a process computes, and for how long."""

    def __init__(self, process: subprocess.Popen, time_limit: float, clock: Callable[[], float]) -> None:
        self._process, self._time_limit, self._clock = psutil.Process(process.pid), time_limit, clock
        self._used = self._idle = 0.0
        self._begin = self._used = self._computed()
        self._looked = clock()

    def look(self) -> None:
        """Look, if it is time to; raise _HungError if it computed for too long, or waited too long for something."""
        now = self._clock()
        if now - self._looked < LOOK:
            return
        computed, before = self._computed(), self._used
        # A look that comes late, on a machine that is busy or slept, counts as one.
        waited = 0.0 if self._runs() else min(now - self._looked, 2.0 * LOOK)
        self._used, self._looked = computed, now
        self._idle = max(0.0, self._idle + waited - PAID * (computed - before))
        if computed - self._begin > self._time_limit or self._idle > self._time_limit:
            raise _HungError

    def _computed(self) -> float:
        """Return the computing time (s) of the process so far."""
        with contextlib.suppress(psutil.Error):
            times = self._process.cpu_times()
            return float(times.user + times.system)
        return self._used

    def _runs(self) -> bool:
        """Return whether the process computes just now, or would if a core were free."""
        with contextlib.suppress(psutil.Error):
            return bool(self._process.status() == psutil.STATUS_RUNNING)
        return False


def path_of_processes() -> List[str]:
    """Return sys.path for processes to start: first where the package was found, since a build's has the kernels.

    A build's package puts its sources, which have none, in front of itself.
    """
    return [os.path.dirname(os.path.dirname(mbf_relay.__file__)), *sys.path]


def packed(call: Callable, argument: object, expected: object = None) -> bytes:
    """Return work for a driver: a function of a module, what it is called with, and the sources it must be of."""
    return pickle.dumps((expected, call, argument), protocol=4)


def run_on_worker(work: bytes, time_limit: float) -> Answer:
    """Do a piece of work in the driver of this thread of a worker."""
    driver = getattr(_of_thread, "driver", None)
    if driver is None:
        driver = _of_thread.driver = Driver()
        _drivers.append(driver)
    return driver.run(work, time_limit)


def end_all() -> None:
    """End every driver of this process."""
    for driver in _drivers:
        driver.end()


_of_thread = threading.local()
_drivers: List[Driver] = []


def main() -> None:
    """Work until there is nothing to do any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # interrupts are the client's to answer
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what plugins print must not get among the answers
    waiting: queue.Queue = queue.Queue()
    threading.Thread(target=_take, args=(sys.stdin.buffer, waiting), daemon=True).start()
    while True:
        try:
            work = waiting.get(timeout=IDLE)
        except queue.Empty:
            os._exit(0)  # Python's own end would wait for the thread that reads, and abort
        answers.write(_framed(pickle.dumps(answer(work), protocol=4)))
        answers.flush()


def answer(work: bytes) -> Answer:
    """Return what becomes of a piece of work in this process."""
    try:
        # from our own worker, not from outside
        expected, call, argument = pickle.loads(work)  # noqa: S301  # nosec B301
        if expected is not None:
            from mbf_relay.lockstep.sources import sources

            difference = expected.difference(sources(sorted(expected.plugins)))
            if difference:
                return REFUSED, difference.encode()
        return DONE, pickle.dumps(call(argument), protocol=4)
    except Exception as error:  # whatever a plugin throws must not end the batch
        from mbf_relay.plugins import PluginFailure

        if isinstance(error, PluginFailure):  # it says where
            return THREW, str(error).encode()
        last = traceback.extract_tb(error.__traceback__)[-1]
        return THREW, f"{type(error).__name__}: {error} ({last.name}, line {last.lineno})".encode()


def _take(stream: BinaryIO, waiting: queue.Queue) -> None:
    """Hand over work as it comes; the worker's end is this process's."""
    try:
        while True:
            waiting.put(_receive(stream))
    except (EOFError, OSError):
        os._exit(0)


def _framed(content: bytes) -> bytes:
    return HEAD.pack(len(content)) + content


def _sent(stream: BinaryIO, content: memoryview) -> memoryview:
    """Write what a pipe takes at once; return what is left, nothing where nobody reads any more."""
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

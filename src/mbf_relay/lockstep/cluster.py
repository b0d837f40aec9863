"""Running work on a Dask cluster: a local one, or an existing one by its scheduler's address.

Dask transports pieces of work and notices workers that are gone. Which worker gets which piece is decided here, so that
the pieces of a lost worker are known and sent again. Each worker thread runs its work in a process of its own (see
`driver`): a crash or a hang costs one result and no worker, also on a cluster that others set up. Workers must have the
same sources as the client; others get no work.
"""

from __future__ import annotations

import asyncio
import concurrent.futures
import json
import queue
import tempfile
import time
from collections import Counter, deque
from contextlib import ExitStack, contextmanager
from itertools import chain
from pathlib import Path
from typing import Any, Callable, Deque, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple, TypeVar

from mbf_relay.lockstep import driver
from mbf_relay.lockstep.episodes import Lost, value_of
from mbf_relay.lockstep.sources import Sources

Argument = TypeVar("Argument")

CONNECTING = 10.0
"""Seconds a scheduler may take to answer; after that there is a warning, or, at the start, an error."""
GATHERING = 20.0
"""Seconds for fetching a finished result; if its worker dies meanwhile, Dask would wait for ever."""
LOOK = 1.0
"""Seconds between two queries of the list of workers."""
AHEAD = 2
"""Pieces of work sent per worker thread: one that runs and one that waits there."""
MOST_TRIES = 5
"""How often a piece of work is sent again after its worker was lost or had other sources."""
GONE = "its worker was lost, again and again"
"""The error of a piece of work whose workers were lost more often than that."""
SETTINGS = {
    "distributed.worker.profile.interval": "1h",  # Dask's profiler samples all threads a hundred times a second
    "distributed.worker.profile.cycle": "1h",
    "distributed.admin.tick.limit": "1h",  # no warnings that the event loop was unresponsive
    "distributed.admin.tick.interval": "1h",  # for those each event loop wakes fifty times a second
}
"""Dask's configuration while a cluster is in use."""


class ClusterError(ValueError):
    """There is no usable cluster; the text says why, in one line."""


class _Piece(NamedTuple):
    """A piece of work, how often it was sent again, and the address of the worker that has it."""

    argument: Any
    tries: int = 0
    worker: str = ""


class DaskCluster:
    """Runs pieces of work (see Workers) on those workers of a Dask client that have the right sources."""

    def __init__(
        self, client: Any, expected: Sources, warn: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take over a client.

        Args:
            client: A connected dask.distributed.Client.
            expected: The sources that workers must have.
            warn: Called with each line for the user.
            clock: Gives the time (s).
        """
        self._client, self._expected, self._warn, self._clock = client, expected, warn, clock
        self._ended: queue.Queue = queue.Queue()  # futures that have finished
        self._fit: Dict[str, bool] = {}  # whether a worker has the right sources, by address
        self._asked: Dict[Any, str] = {}  # address of the worker that is asked for its sources, by future
        self._threads: Dict[str, int] = {}  # number of threads of each worker, by address
        self._time_limit = 0.0
        self._query: Optional[concurrent.futures.Future] = None  # of the list of workers, under way
        self._queried_at = float("-inf")
        self._told = ""

    def run(
        self, call: Callable[[Argument], Any], arguments: Sequence[Argument], time_limit: float
    ) -> Iterator[Tuple[Argument, Any]]:
        """Yield each argument with its result; see Workers.

        Raises:
            ClusterError: The scheduler is gone, or no worker has the right sources.
        """
        self._time_limit = time_limit
        waiting: Deque[_Piece] = deque(_Piece(argument) for argument in arguments)
        flying: Dict[Any, _Piece] = {}
        try:
            while waiting or flying:
                self._update_workers()
                self._send_all(call, waiting, flying)
                gone = [(future, _Unfit(GONE)) for future, piece in flying.items() if piece.worker not in self._fit]
                for future, value in chain(gone, self._arrived(flying)):
                    piece = flying.pop(future)
                    future.release()
                    if isinstance(value, _Unfit) and piece.tries < MOST_TRIES:
                        waiting.append(_Piece(piece.argument, piece.tries + 1))
                    else:
                        yield piece.argument, Lost(str(value)) if isinstance(value, _Unfit) else value
        finally:
            for future in flying:
                future.release()  # does not wait for the scheduler, which may hang

    def _send_all(self, call: Callable, waiting: Deque[_Piece], flying: Dict[Any, _Piece]) -> None:
        """Send work to usable workers, up to AHEAD pieces per thread."""
        threads = {address: count for address, count in self._threads.items() if self._fit.get(address)}
        held = Counter(piece.worker for piece in flying.values())
        while waiting and threads:
            # Near the end only one each, lest a piece wait at one worker while another is idle.
            most = AHEAD if len(waiting) > sum(threads.values()) else 1
            worker = min(threads, key=lambda address: held[address] / threads[address])
            if held[worker] >= most * threads[worker]:
                return
            piece = waiting.popleft()._replace(worker=worker)
            held[worker] += 1
            flying[self._send(driver.packed(call, piece.argument, self._expected), worker)] = piece

    def _send(self, work: bytes, worker: str) -> Any:
        """Submit work for one worker, without letting Dask move it to another; return the future."""
        future = self._client.submit(
            driver.run_on_worker, work, self._time_limit, pure=False, workers=[worker], allow_other_workers=False
        )
        future.add_done_callback(self._ended.put)
        return future

    def _arrived(self, flying: Dict[Any, _Piece]) -> Iterator[Tuple[Any, Any]]:
        """Wait up to LOOK for finished futures; yield those of work, each with its result."""
        for future in self._wait():
            if future in self._asked:
                self._judge(future)
            elif future in flying:  # else it belongs to a lost worker, or to an earlier run that was aborted
                yield future, self._result_of(future)

    def _wait(self) -> List[Any]:
        """Return the futures that have finished, after LOOK at most."""
        try:
            ended = [self._ended.get(timeout=LOOK)]
        except queue.Empty:
            return []
        while not self._ended.empty():
            ended.append(self._ended.get())
        return ended

    def _result_of(self, future: Any) -> Any:
        """Return the result of a finished future: a value, Lost where the work failed, _Unfit where it did not run."""
        if future.status == "cancelled":
            self._require_scheduler()
            return Lost("was cancelled at the scheduler")
        fetched = self._fetched(future)
        if fetched is None or fetched.cancelled():
            return _Unfit(GONE)
        error = fetched.exception()
        if error is None:
            (answer,) = fetched.result()
            return _Unfit(answer[1].decode()) if answer[0] == driver.REFUSED else value_of(answer)
        if type(error).__name__ == "KilledWorker":
            return _Unfit(GONE)
        if isinstance(error, ImportError):
            return _Unfit(f"cannot work: {error}")
        return Lost(f"{type(error).__name__}: {error}")

    def _fetched(self, future: Any) -> Optional[concurrent.futures.Future]:
        """Fetch the result of a finished future from its worker; None where that is lost meanwhile."""
        coming = self._in_loop(self._client.gather([future], asynchronous=True))
        begun = self._clock()
        while not concurrent.futures.wait([coming], LOOK).done:
            if future.status in ("pending", "lost") or self._clock() - begun > GATHERING:
                return None
            self._update_workers()  # raises where the scheduler is gone, which knows where the result is
        return coming

    def _update_workers(self) -> None:
        """Query the list of workers, once in LOOK, and ask new ones for their sources."""
        if self._query is None and self._clock() - self._queried_at < LOOK:
            return
        self._require_scheduler()
        threads = self._queried()
        if threads is None:
            return
        self._threads = threads
        self._fit = {address: is_fit for address, is_fit in self._fit.items() if address in threads}
        for future in [future for future, address in self._asked.items() if address not in threads]:
            del self._asked[future]
            future.release()
        for address in sorted(set(threads) - set(self._fit) - set(self._asked.values())):
            work = driver.packed(_sources, sorted(self._expected.plugins), self._expected)
            self._asked[self._send(work, address)] = address
        self._tell("" if threads else f"no worker is at {self._client.scheduler.address} yet; waiting for one")

    def _queried(self) -> Optional[Dict[str, int]]:
        """Return the number of threads of each worker by address; None where the scheduler has not answered yet."""
        if self._query is None:
            self._query, self._queried_at = self._in_loop(self._client.scheduler.ncores()), self._clock()
        if not concurrent.futures.wait([self._query], LOOK).done:
            if self._clock() - self._queried_at > CONNECTING:
                self._tell(f"the scheduler at {self._client.scheduler.address} does not answer; waiting for it")
            return None
        answer, self._query = self._query, None
        try:
            return dict(answer.result())
        except (OSError, concurrent.futures.TimeoutError):
            return None  # the connection broke; the client notices whether the scheduler is gone

    def _in_loop(self, coroutine: Any) -> concurrent.futures.Future:
        """Start a coroutine in the client's event loop; return its future."""
        return asyncio.run_coroutine_threadsafe(coroutine, self._client.loop.asyncio_loop)

    def _tell(self, line: str) -> None:
        """Warn of why the work waits; the same line once, until it changes. Empty where nothing is wrong."""
        if line and line != self._told:
            self._warn(line)
        self._told = line

    def _judge(self, future: Any) -> None:
        """Take a worker's answer about its sources, and note whether it is usable.

        Raises:
            ClusterError: No worker is.
        """
        address = self._asked.pop(future)
        found = self._result_of(future)
        future.release()
        if found == GONE:
            return  # if the worker still exists, it is asked again
        unable = f"cannot work: {found}" if isinstance(found, Lost) else str(found)
        difference = "" if isinstance(found, Sources) else unable
        self._fit[address] = not difference
        if difference:
            self._warn(f"worker {address} {difference}; it gets no work")
        if self._fit and not self._asked and not any(self._fit.values()):
            raise ClusterError(f"no worker is fit; {address} {difference}")

    def _require_scheduler(self) -> None:
        if self._client.status not in ("running", "connecting"):
            raise ClusterError(f"the scheduler is gone ({self._client.status}); what was finished is kept")


class _Unfit(str):
    """Why a worker did not run a piece of work; it may be sent again."""


def _sources(plugins: Sequence[str]) -> Sources:
    from mbf_relay.lockstep.sources import sources

    return sources(plugins)


@contextmanager
def connected(
    expected: Sources, processes: int, say: Callable[[str], None], scheduler: str = "",
    scheduler_file: Optional[Path] = None,
) -> Iterator[DaskCluster]:
    """Give a cluster in a `with` block: an existing one, or a local one that ends with the block.

    Args:
        expected: The sources that workers must have.
        processes: Number of processes of a local cluster.
        say: Called with each line for the user.
        scheduler: Address of an existing cluster's scheduler, such as tcp://HOST:8786.
        scheduler_file: Instead of it, the file that the scheduler wrote its address to.

    Raises:
        ClusterError: Dask is not installed, or no scheduler answers.
    """
    try:
        import dask
        import distributed
    except ImportError as error:
        raise ClusterError(
            f"a cluster needs dask.distributed (python3-distributed): {error}; --jobs 1 needs none"
        ) from error
    with ExitStack() as stack:
        stack.enter_context(dask.config.set(SETTINGS))
        if scheduler or scheduler_file is not None:
            client = _client_of(distributed, scheduler, scheduler_file)  # drivers there end by themselves, see IDLE
            stack.callback(client.close)
        else:
            # Its workers are threads of this process and cannot be lost, but after a laptop's sleep they would exceed
            # worker-ttl. They write nothing to disk, so that the folder Dask wants is removed before the work begins.
            with tempfile.TemporaryDirectory(prefix="mbf_relay-") as folder, dask.config.set({
                "temporary-directory": folder, "distributed.scheduler.worker-ttl": None,
            }):
                local = stack.enter_context(distributed.LocalCluster(
                    n_workers=processes, threads_per_worker=1, processes=False, memory_limit=0,
                    dashboard_address="127.0.0.1:0", silence_logs=50,
                ))
            link = dask.config.get("distributed.dashboard.link", "").replace("{host}", "127.0.0.1")  # as it listens
            stack.enter_context(dask.config.set({"distributed.dashboard.link": link}))
            client = stack.enter_context(distributed.Client(local, set_as_default=False))
            stack.callback(driver.end_all)
        dashboard = getattr(client, "dashboard_link", "")  # missing in the version that Noetic's Ubuntu has
        if dashboard:
            say(f"dashboard: {dashboard}")
        yield DaskCluster(client, expected, say)


def _client_of(distributed: Any, scheduler: str, scheduler_file: Optional[Path]) -> Any:
    where = scheduler or str(scheduler_file)
    try:
        address = _checked(distributed, scheduler or _written_in(scheduler_file))
        return distributed.Client(address, timeout=CONNECTING, set_as_default=False, name="mbf_relay")
    except (OSError, ValueError) as error:
        raise ClusterError(f"no scheduler answers at {where}: {' '.join(str(error).split())}") from error


def _written_in(scheduler_file: Optional[Path]) -> str:
    """Return the address in a scheduler's file; raise OSError or ValueError where there is none."""
    assert scheduler_file is not None
    if not scheduler_file.is_file():
        raise ValueError("there is no such file")
    held = json.loads(scheduler_file.read_text(encoding="utf-8"))
    if not isinstance(held, dict) or not isinstance(held.get("address"), str):
        raise ValueError("the file holds no address")
    return str(held["address"])


def _checked(distributed: Any, address: str) -> str:
    """Return an address if it is valid, else raise ValueError; a Client that fails on its address never closes."""
    scheme, place = distributed.comm.addressing.parse_address(address)
    distributed.comm.registry.get_backend(scheme).get_address_host(place)
    return address

"""Work on a Dask cluster: one on this machine, or one that somebody already has.

Dask carries pieces of work to the workers they are meant for, and finds workers that died or stopped. Which worker gets
which piece is decided here: what is known to be at a worker that is gone is sent to another, and no piece depends on
what Dask makes of it. A worker is a thread that watches a process of its own (see `driver`), so that what crashes or
hangs costs one result and no worker, on a cluster of anybody's making. Here and there workers must have the client's
sources, or they get no work.
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
"""Seconds a scheduler may take to answer, or it is said that it does not."""
GATHERING = 20.0
"""Seconds for a result that is there to arrive; its worker may die on the way, and Dask would wait for ever."""
LOOK = 1.0
"""Seconds between two looks at which workers there are."""
AHEAD = 2
"""Pieces of work sent per thread: one in work, one that waits there already."""
MOST_TRIES = 5
"""How often work is sent again that came to a worker of other sources, or to one that was lost."""
GONE = "its worker was lost, again and again"
"""What is said of work that was sent again too often because of that."""
SETTINGS = {
    "distributed.worker.profile.interval": "1h",  # it would look at our threads a hundred times a second
    "distributed.worker.profile.cycle": "1h",
    "distributed.admin.tick.limit": "1h",  # a busy machine is no news
    "distributed.admin.tick.interval": "1h",  # to find that out, each loop would wake fifty times a second
}


class ClusterError(ValueError):
    """There is no cluster to work on; the text says why, in one line."""


class _Piece(NamedTuple):
    """A piece of work, how often it was sent already, and the worker it is at."""

    argument: Any
    tries: int = 0
    worker: str = ""


class DaskCluster:
    """A Dask client, and which of its workers are fit for our work."""

    def __init__(
        self, client: Any, expected: Sources, warn: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Take a client.

        Args:
            client: Of dask.distributed, connected.
            expected: The sources that workers must have.
            warn: Takes a line for people.
            clock: Tells the time (s).
        """
        self._client, self._expected, self._warn, self._clock = client, expected, warn, clock
        self._ended: queue.Queue = queue.Queue()
        self._fit: Dict[str, bool] = {}
        self._asked: Dict[Any, str] = {}
        self._threads: Dict[str, int] = {}
        self._time_limit = 0.0
        self._looked = float("-inf")
        self._look_under_way: Optional[concurrent.futures.Future] = None
        self._told = ""

    def run(
        self, call: Callable[[Argument], Any], arguments: Sequence[Argument], time_limit: float
    ) -> Iterator[Tuple[Argument, Any]]:
        """Yield each argument and what came of it; see Workers.

        Raises:
            ClusterError: The scheduler is gone, or no worker is fit.
        """
        self._time_limit = time_limit
        waiting: Deque[_Piece] = deque(_Piece(argument) for argument in arguments)
        flying: Dict[Any, _Piece] = {}
        try:
            while waiting or flying:
                self._look()
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
                future.release()  # of which a scheduler that hangs need not know

    def _send_all(self, call: Callable, waiting: Deque[_Piece], flying: Dict[Any, _Piece]) -> None:
        """Send work to fit workers, as long as they have room for it."""
        threads = {address: count for address, count in self._threads.items() if self._fit.get(address)}
        held = Counter(piece.worker for piece in flying.values())
        while waiting and threads:
            # In the end no piece is to wait at one worker while another has nothing to do.
            most = AHEAD if len(waiting) > sum(threads.values()) else 1
            worker = min(threads, key=lambda address: held[address] / threads[address])
            if held[worker] >= most * threads[worker]:
                return
            piece = waiting.popleft()._replace(worker=worker)
            held[worker] += 1
            flying[self._send(driver.packed(call, piece.argument, self._expected), worker)] = piece

    def _send(self, work: bytes, worker: str) -> Any:
        """Send work to a worker, which Dask is not to give to another: we know who has what, and see who is gone."""
        future = self._client.submit(
            driver.run_on_worker, work, self._time_limit, pure=False, workers=[worker], allow_other_workers=False
        )
        future.add_done_callback(self._ended.put)
        return future

    def _arrived(self, flying: Dict[Any, _Piece]) -> Iterator[Tuple[Any, Any]]:
        """Yield what ended meanwhile, each with what came of it."""
        for future in self._wait():
            if future in self._asked:
                self._judge(future)
            elif future in flying:  # else of a run that was given up, or of a worker that was lost
                yield future, self._value(future)

    def _wait(self) -> List[Any]:
        """Return what ended meanwhile."""
        try:
            ended = [self._ended.get(timeout=LOOK)]
        except queue.Empty:
            return []
        while not self._ended.empty():
            ended.append(self._ended.get())
        return ended

    def _value(self, future: Any) -> Any:
        """Return what came of a piece of work: its value, Lost, or _Unfit."""
        if future.status == "cancelled":
            self._require_scheduler()
            return Lost("was cancelled at the scheduler")
        coming = self._in_loop(self._client.gather([future], asynchronous=True))
        begun = self._clock()
        while not concurrent.futures.wait([coming], LOOK).done:
            if future.status in ("pending", "lost") or self._clock() - begun > GATHERING:
                return _Unfit(GONE)
            self._look()  # it may be the scheduler that hangs, who is asked where the result is
        error = None if coming.cancelled() else coming.exception()
        if coming.cancelled() or type(error).__name__ == "KilledWorker":
            return _Unfit(GONE)
        if error is None:
            (answer,) = coming.result()
            return _Unfit(answer[1].decode()) if answer[0] == driver.REFUSED else value_of(answer)
        if isinstance(error, ImportError):
            return _Unfit(f"cannot work: {error}")
        return Lost(f"{type(error).__name__}: {error}")

    def _look(self) -> None:
        """See which workers there are, and ask new ones for their sources."""
        if self._clock() - self._looked < LOOK and self._look_under_way is None:
            return
        self._require_scheduler()
        threads = self._threads_now()
        if threads is None:
            return
        self._threads = threads
        for gone in set(self._fit) - set(threads):
            del self._fit[gone]
        for future in [future for future, address in self._asked.items() if address not in threads]:
            del self._asked[future]
            future.release()
        for address in sorted(set(threads) - set(self._fit) - set(self._asked.values())):
            work = driver.packed(_sources, sorted(self._expected.plugins), self._expected)
            self._asked[self._send(work, address)] = address
        self._tell("" if threads else f"no worker is at {self._client.scheduler.address} yet; waiting for one")

    def _threads_now(self) -> Optional[Dict[str, int]]:
        """Return how many threads each worker has; None where the scheduler has not answered yet."""
        if self._look_under_way is None:
            self._looked = self._clock()
            self._look_under_way = self._in_loop(self._client.scheduler.ncores())
        look = self._look_under_way
        if not concurrent.futures.wait([look], LOOK).done:
            if self._clock() - self._looked > CONNECTING:
                self._tell(f"the scheduler at {self._client.scheduler.address} does not answer; waiting for it")
            return None
        self._look_under_way = None
        try:
            return dict(look.result())
        except (OSError, concurrent.futures.TimeoutError):
            return None  # the connection broke; whether the scheduler is gone the client finds out

    def _in_loop(self, coroutine: Any) -> concurrent.futures.Future:
        """Have a coroutine run in the client's loop, without waiting for it."""
        return asyncio.run_coroutine_threadsafe(coroutine, self._client.loop.asyncio_loop)

    def _tell(self, line: str) -> None:
        """Tell what keeps the work waiting, once until something else does or nothing."""
        if line and line != self._told:
            self._warn(line)
        self._told = line

    def _judge(self, future: Any) -> None:
        """Take a worker's answer about its sources."""
        address = self._asked.pop(future)
        found = self._value(future)
        future.release()
        if found == GONE:
            return  # one that is there nevertheless is asked again
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
    """Why a worker did not do its work."""


def _sources(plugins: Sequence[str]) -> Sources:
    from mbf_relay.lockstep.sources import sources

    return sources(plugins)


@contextmanager
def connected(
    expected: Sources, processes: int, say: Callable[[str], None], scheduler: str = "",
    scheduler_file: Optional[Path] = None,
) -> Iterator[DaskCluster]:
    """Give a cluster for a while: the one of a scheduler, or else one on this machine.

    Args:
        expected: The sources that workers must have.
        processes: On this machine, where no scheduler is named.
        say: Takes lines for people.
        scheduler: Its address, such as tcp://HOST:8786.
        scheduler_file: The file a scheduler wrote its address to.

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
            client = _client_of(distributed, scheduler, scheduler_file)  # drivers there end for want of work
            stack.callback(client.close)
        else:
            # Its workers are threads here and cannot be lost; after a laptop's sleep they would be taken for it. They
            # keep nothing on the disk either: the folder Dask asks for is gone before the work begins.
            with tempfile.TemporaryDirectory(prefix="mbf_relay-") as folder, dask.config.set({
                "temporary-directory": folder, "distributed.scheduler.worker-ttl": None,
            }):
                local = stack.enter_context(distributed.LocalCluster(
                    n_workers=processes, threads_per_worker=1, processes=False, memory_limit=0,
                    dashboard_address="127.0.0.1:0", silence_logs=50,
                ))
            link = dask.config.get("distributed.dashboard.link", "").replace("{host}", "127.0.0.1")  # it has no other
            stack.enter_context(dask.config.set({"distributed.dashboard.link": link}))
            client = stack.enter_context(distributed.Client(local, set_as_default=False))
            stack.callback(driver.end_all)
        dashboard = getattr(client, "dashboard_link", "")  # which Noetic's does not tell
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
    """Return an address that a client can be made for; raise ValueError where it is none.

    A client that fails over its address is never done with closing.
    """
    scheme, place = distributed.comm.addressing.parse_address(address)
    distributed.comm.registry.get_backend(scheme).get_address_host(place)
    return address

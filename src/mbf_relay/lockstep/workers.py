"""Chooses where work is run: in this process, on this machine's cores, or on a cluster."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from pathlib import Path
from typing import Callable, Iterator, List, Optional, Sequence

from mbf_relay.lockstep.episodes import EpisodeJob, InProcess, Workers, drive_all
from mbf_relay.lockstep.options import TIME_LIMIT
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.sources import plugins_of, sources


def tell(line: str) -> None:
    """Print a line to stderr."""
    print(line, file=sys.stderr)


@contextmanager
def workers_for(
    count: int, processes: int, plugins: Sequence[str] = (), scheduler: str = "",
    scheduler_file: Optional[Path] = None, say: Callable[[str], None] = tell,
) -> Iterator[Workers]:
    """Give workers in a `with` block: this process for one piece of work or one process, else a cluster.

    Args:
        count: Number of pieces of work.
        processes: Number of processes on this machine, where no scheduler is given.
        plugins: Types of the user's plugins, which workers must have.
        scheduler: Address of a Dask scheduler.
        scheduler_file: Instead of it, the file that the scheduler wrote its address to.
        say: Called with each line for the user.

    Raises:
        ValueError: The cluster cannot be reached, or Dask is not installed.
    """
    if not scheduler and scheduler_file is None and min(processes, count) <= 1:
        yield InProcess()
        return
    from mbf_relay.lockstep.cluster import connected  # only where it is used, as drives need no Dask

    with connected(sources(plugins), min(processes, max(1, count)), say, scheduler, scheduler_file) as cluster:
        yield cluster


def run(jobs: Sequence[EpisodeJob], processes: int, time_limit: float = TIME_LIMIT) -> List[EpisodeResult]:
    """Drive episodes and return their results in the order of `jobs`, a failed one where the work was lost."""
    plugins = sorted({name for setup in {id(job.setup): job.setup for job in jobs}.values()
                      for name in plugins_of(setup)})
    with workers_for(len(jobs), processes, plugins, say=lambda line: None) as workers:
        ended = {id(job): result for job, result in drive_all(jobs, workers, time_limit)}
    return [ended[id(job)] for job in jobs]

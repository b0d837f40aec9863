"""Where a command's work is done: here, on the cores of this machine, or on a cluster."""

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
    """Tell a line to whoever watches."""
    print(line, file=sys.stderr)


@contextmanager
def workers_for(
    count: int, processes: int, plugins: Sequence[str] = (), scheduler: str = "",
    scheduler_file: Optional[Path] = None, say: Callable[[str], None] = tell,
) -> Iterator[Workers]:
    """Give a place to work for a while: this process for one piece or one process, a cluster else.

    Args:
        count: Pieces of work.
        processes: On this machine, where no scheduler is named.
        plugins: Types of plugins that are not the package's, which workers must have.
        scheduler: Address of a Dask scheduler.
        scheduler_file: The file a scheduler wrote its address to.
        say: Takes lines for people.

    Raises:
        ValueError: There is no such cluster, or none without Dask; the text says so.
    """
    if not scheduler and scheduler_file is None and min(processes, count) <= 1:
        yield InProcess()
        return
    from mbf_relay.lockstep.cluster import connected  # only here: a drive needs no Dask

    with connected(sources(plugins), min(processes, max(1, count)), say, scheduler, scheduler_file) as cluster:
        yield cluster


def run(jobs: Sequence[EpisodeJob], processes: int, time_limit: float = TIME_LIMIT) -> List[EpisodeResult]:
    """Drive episodes and return their results in the order of `jobs`; what was lost is a failed result."""
    plugins = sorted({name for setup in {id(job.setup): job.setup for job in jobs}.values()
                      for name in plugins_of(setup)})
    with workers_for(len(jobs), processes, plugins, say=lambda line: None) as workers:
        ended = {(job.task.name, job.seed): result for job, result in drive_all(jobs, workers, time_limit)}
    return [ended[job.task.name, job.seed] for job in jobs]

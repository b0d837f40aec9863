"""Dask clusters: workers that die, stop, come late or have other sources, and schedulers that are not there."""

import ctypes
import json
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import psutil
import pytest

pytest.importorskip("pybullet")
distributed = pytest.importorskip("distributed")
sys.path.insert(0, str(Path(__file__).parent))

import small_worlds  # noqa: E402
from tally import LONG  # noqa: E402

import mbf_relay  # noqa: E402
from mbf_relay.lockstep import batch  # noqa: E402
from mbf_relay.lockstep.cluster import GONE, ClusterError, DaskCluster, _Unfit, connected  # noqa: E402
from mbf_relay.lockstep.driver import path_of_processes  # noqa: E402
from mbf_relay.lockstep.episodes import EpisodeJob, InProcess, drive_all  # noqa: E402
from mbf_relay.lockstep.settings import config_folder  # noqa: E402
from mbf_relay.lockstep.setup import make_setup  # noqa: E402
from mbf_relay.lockstep.sources import sources  # noqa: E402
from mbf_relay.lockstep.tasks import load_tasks  # noqa: E402

ROOT = Path(__file__).resolve().parents[3]
PACKAGE = Path(mbf_relay.__file__).parents[1]
"""Where the package was found: a build's has the kernels, which numba would compile anew in each process."""
PATIENCE = 300
DEATH_OF_PARENT = 1
"""Linux's prctl: which signal a process gets when the thread that started it ends."""
LIBC = ctypes.CDLL(None)


class Processes:
    """A scheduler and workers in processes of their own; nothing of it is left in the end, however that comes.

    A worker that was stopped ends by nothing but SIGKILL.
    """

    def __init__(self, folder):
        self._folder, self._all = folder, []
        self.file = folder / "scheduler.json"

    def _start(self, module, *arguments, source=PACKAGE):
        environment = {
            **os.environ, "PYTHONPATH": str(source), "DASK_DISTRIBUTED__SCHEDULER__WORKER_TTL": "15s",
            "DASK_TEMPORARY_DIRECTORY": str(self._folder),
        }
        with open(self._folder / f"{len(self._all)}.log", "w") as log:
            self._all.append(subprocess.Popen(
                [sys.executable, "-m", f"distributed.cli.dask_{module}", "--scheduler-file", self.file, *arguments],
                env=environment, stdout=log, stderr=log, cwd=str(self._folder),
                preexec_fn=lambda: LIBC.prctl(DEATH_OF_PARENT, signal.SIGKILL),
            ))
        return self._all[-1]

    def scheduler(self):
        process = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        until(self.file.is_file)
        return process

    def worker(self, name, source=PACKAGE):
        arguments = ("--name", name, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--memory-limit", "0")
        return self._start("worker", *arguments, source=source)

    def end(self):
        for process in self._all:
            process.kill()
            process.wait()


@pytest.fixture
def processes(tmp_path):
    made = Processes(tmp_path)
    yield made
    made.end()


def until(condition):
    for _ in range(10 * PATIENCE):
        if condition():
            return
        pytest.importorskip("select").select([], [], [], 0.1)
    raise AssertionError(f"waited {PATIENCE} s in vain")


def results_of(cluster, arguments, first=lambda: None):
    """Return what comes of roots of numbers, in time; `first` is called once, after the first of them."""
    results, failed = {}, []

    def work():
        try:
            for argument, value in cluster.run(math.sqrt, arguments, 60.0):
                if not results:
                    first()
                results[argument] = value
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    assert not thread.is_alive(), f"the batch hangs with {len(results)} of {len(arguments)} results"
    assert not failed, failed
    return results


def jobs_of(tmp_path, seeds, *worlds):
    tasks = load_tasks(small_worlds.write(tmp_path / "worlds.json", *worlds))
    setup = make_setup(config_folder(), has_map=False)
    return [EpisodeJob(task, setup, seed) for seed in seeds for task in tasks]


def test_workers_that_die_stop_and_come_change_no_result(tmp_path, processes):
    worlds = [small_worlds.BENT, small_worlds.FREE] if LONG else [small_worlds.NEAR]
    jobs = jobs_of(tmp_path, range(1, 31 if LONG else 17), *worlds)
    processes.scheduler()
    first, second, _third = (processes.worker(name) for name in ("one", "two", "three"))
    ended = {}
    with connected(sources([]), 0, scheduler_file=processes.file, say=lambda line: None) as cluster:
        until(lambda: len(cluster._client.nthreads()) == 3)
        for job, result in drive_all(jobs, cluster, 900.0):
            assert (job.task.name, job.seed) not in ended, "nothing is counted twice"
            ended[job.task.name, job.seed] = result.drive()
            if len(ended) == 5:
                first.kill()
            if len(ended) == 9:
                second.send_signal(signal.SIGSTOP)
                processes.worker("late")
    assert len(ended) == len(jobs) == (60 if LONG else 16)
    alone = {(job.task.name, job.seed): result.drive() for job, result in drive_all(jobs, InProcess(), 900.0)}
    assert ended == alone, "one seed is one drive, wherever it is driven"


def test_work_goes_to_a_worker_that_comes_after_all_others_were_lost(tmp_path, processes):
    """While one that is not fit is about, work is for those that are; none of them may be there any more."""
    processes.scheduler()
    only = processes.worker("only")
    processes.worker("bare", source=tmp_path)

    def lose():
        only.kill()
        processes.worker("late")

    with connected(sources([]), 0, scheduler_file=processes.file, say=lambda line: None) as cluster:
        until(lambda: len(cluster._client.nthreads()) == 2)
        numbers = [float(number) for number in range(40)]
        assert results_of(cluster, numbers, lose) == {number: math.sqrt(number) for number in numbers}


def test_a_scheduler_that_hangs_is_named_and_a_batch_on_it_goes_on_later_or_can_be_given_up(processes, monkeypatch):
    named = threading.Event()  # on a busy machine perhaps before it is stopped

    def tell(line):
        if "does not answer; waiting for it" in line:
            named.set()

    def stop_until_named():
        scheduler.send_signal(signal.SIGSTOP)
        threading.Thread(
            target=lambda: (named.wait(PATIENCE), scheduler.send_signal(signal.SIGCONT)), daemon=True).start()

    scheduler = processes.scheduler()
    processes.worker("one")
    with connected(sources([]), 0, scheduler_file=processes.file, say=tell) as cluster:
        until(lambda: len(cluster._client.nthreads()) == 1)
        monkeypatch.setattr("mbf_relay.lockstep.cluster.CONNECTING", 1.0)
        numbers = [float(number) for number in range(40)]
        assert len(results_of(cluster, numbers, stop_until_named)) == 40
        assert named.is_set()
        begun = cluster.run(math.sqrt, numbers, 60.0)
        next(begun)
        scheduler.send_signal(signal.SIGSTOP)
        ended = threading.Thread(target=begun.close, daemon=True)
        ended.start()
        ended.join(PATIENCE)
        scheduler.send_signal(signal.SIGCONT)
        assert not ended.is_alive(), "it cannot be interrupted"


def test_a_batch_goes_on_whose_only_worker_dies_while_it_is_asked_for_its_sources(monkeypatch):
    told = []
    cluster = DaskCluster(None, sources([]), told.append)
    future = type("Future", (), {"release": lambda self: None})()
    cluster._asked = {future: "tcp://127.0.0.1:1"}
    cluster._fit["tcp://127.0.0.1:2"] = False  # of other sources
    monkeypatch.setattr(cluster, "_result_of", lambda future: _Unfit(GONE))
    cluster._judge(future)
    assert not told and not cluster._asked, "it may come back, and is asked then"


def test_no_worker_outlives_a_test_that_is_killed(tmp_path):
    code = (
        "import signal, sys; from pathlib import Path; import test_cluster\n"
        "made = test_cluster.Processes(Path(sys.argv[1]))\n"
        "all = [made.scheduler(), made.worker('one'), made.worker('stopped')]\n"
        "all[2].send_signal(signal.SIGSTOP)\n"
        "print(*(process.pid for process in all), flush=True)\n"
        "sys.stdin.read()"
    )
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *path_of_processes()])}
    test = subprocess.Popen(
        [sys.executable, "-c", code, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment)
    with test.stdin, test.stdout:
        its = [psutil.Process(int(number)) for number in test.stdout.readline().split()]
        test.kill()
        test.wait()
    assert len(its) == 3
    until(lambda: not any(process.is_running() and process.status() != psutil.STATUS_ZOMBIE for process in its))


def test_a_worker_of_other_sources_and_one_without_the_package_get_no_work(tmp_path, processes):
    other = tmp_path / "other"
    for name in ("src/mbf_relay", "config"):
        shutil.copytree(ROOT / name, other / name, ignore=shutil.ignore_patterns("__pycache__", "ros", "maps"))
    shutil.copy(ROOT / "package.xml", other)
    for built in (PACKAGE / "mbf_relay").glob("_kernels*"):
        shutil.copy(built, other / "src" / "mbf_relay")
    with open(other / "src" / "mbf_relay" / "geometry.py", "a", encoding="utf-8") as file:
        file.write("# changed\n")
    told = []
    processes.scheduler()
    processes.worker("other", source=other / "src")
    processes.worker("bare", source=tmp_path)
    jobs = jobs_of(tmp_path, [1, 2], small_worlds.NEAR)
    with connected(sources([]), 0, scheduler_file=processes.file, say=told.append) as cluster:
        until(lambda: len(cluster._client.nthreads()) == 2)
        with pytest.raises(ClusterError, match="no worker is fit"):
            list(drive_all(jobs, cluster, 900.0))
        processes.worker("good")
        until(lambda: len(cluster._client.nthreads()) == 3)
        results = [result for _, result in drive_all(jobs, cluster, 900.0)]
    assert len(results) == 2 and all(result.success for result in results), [result.message for result in results]
    text = "\n".join(told)
    assert "has other sources of version" in text and "cannot work: No module named 'mbf_relay'" in text


def test_the_dashboard_that_is_told_is_there():
    """Told was the machine's address in its network, where nothing listens: the dashboard is this machine's alone."""
    told = []
    with connected(sources([]), 1, say=told.append):
        for line in told:  # Noetic's Dask tells none
            host, port = line.partition("//")[2].partition("/")[0].split(":")
            socket.create_connection((host, int(port)), PATIENCE).close()


def test_a_machine_that_slept_has_lost_none_of_its_own_workers():
    with connected(sources([]), 1, say=lambda line: None) as cluster:
        scheduler = cluster._client.cluster.scheduler
        assert scheduler.workers and not scheduler.worker_ttl, "they would be older than that when it wakes up"


def test_a_batch_killed_at_work_leaves_nothing_in_the_temporary_folder(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with connected(sources([]), 1, say=lambda line: None) as cluster:
        ((_, value),) = cluster.run(math.sqrt, [4.0], 60.0)
        assert value == 2.0
        assert not list(tmp_path.iterdir()), "nobody would be there to remove it after kill -9"


@pytest.mark.parametrize("option", ["--scheduler", "--scheduler-file"])
def test_a_scheduler_that_is_not_there_is_named(tmp_path, capsys, option, monkeypatch):
    monkeypatch.setattr("mbf_relay.lockstep.cluster.CONNECTING", 1.0)
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.NEAR)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        where = f"tcp://127.0.0.1:{taken.getsockname()[1]}" if option == "--scheduler" else str(tmp_path / "none.json")
        assert batch.main([worlds, option, where, "--out", str(tmp_path / "out")]) == 1
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("batch.py:")]
    assert len(lines) == 1 and where in lines[0]


@pytest.mark.parametrize("address, why", [
    ("somewhere", "missing port number"), ("carrier-pigeon://somewhere:1", "carrier-pigeon"), (5, "holds no address"),
    (None, "line 1 column 1")])
def test_a_mistyped_address_or_another_file_is_named_at_once(tmp_path, capsys, address, why):
    file = tmp_path / "scheduler.json"
    file.write_text("junk" if address is None else json.dumps({"address": address}))
    options = [("--scheduler-file", str(file))] + [("--scheduler", address)] * isinstance(address, str)
    worlds = small_worlds.write(tmp_path / "worlds.json", small_worlds.NEAR)
    for option, where in options:
        assert batch.main([worlds, option, where, "--out", str(tmp_path / "out")]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith(f"batch.py: no scheduler answers at {where}: ") and why in line

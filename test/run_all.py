"""Run the linters and every test: pytest folder by folder, each rostest on a ROS master of its own.

On each core something computes, which gives way to what does not: robots that drive in real time, and nodes that wait
for each other, as many of them at a time as their shares of a core fit the machine. One job whose robots' time matters
runs at a time, beside it one whose simulator waits.

The last line is "N passed, N failed"; the exit status is 0 only where none failed. Everything the tests and their nodes
wrote stays in the results folder.
"""

import argparse
import contextlib
import enum
import fcntl
import glob
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from typing import Dict, Iterator, List, NamedTuple, Optional

import job_processes
import job_reports
import job_times

TEST_FOLDER = os.path.dirname(os.path.abspath(__file__))
CHECKOUT = os.path.dirname(TEST_FOLDER)
TIME_LIMIT = 1250.0
"""Wall seconds, less those it waited for a core, after which one job is ended and counts as failed; --long multiplies
it."""
LONGER = 6

PATIENT = (
    "circle", "circle_subscriber", "composed", "demo", "fuzzed_services", "goals", "move_base", "readme_commands",
    "rviz_goal", "soak", "users_launch_files", "web_browser",
)
"""Jobs of `system/` that lose nothing when their nodes get a core late, since the simulator waits for the command that
answers a scan (`command_patience`); two of them may run at once."""
DRIVES_SHARE, NODES_SHARE = 0.75, 0.25
"""Of a core: what the whole graph, or the nodes that a folder of unit tests starts, and single nodes take in a test."""
MORE = 3
"""Jobs that may run beside as many as there are cores."""
SLOWEST = 8
"""Jobs whose time is told at the end; `--times` tells all."""


class Kind(enum.Enum):
    """What a job runs, and so how its outcome is read."""

    LINTER = "a linter, by its status"
    PYTEST = "a folder of pytest files, by its report"
    ROSTEST = "a rostest, by its summary"


class Job(NamedTuple):
    """One process that checks something."""

    name: str
    command: List[str]
    kind: Kind

    @property
    def drives(self) -> bool:
        """Whether a robot drives in it, in real time."""
        return self.name.startswith(("system/", "node/velocity_guard"))

    @property
    def is_patient(self) -> bool:
        """Whether it drives, and may do so beside another one."""
        return self.drives and os.path.splitext(os.path.basename(self.name))[0] in PATIENT

    @property
    def share(self) -> float:
        """How much of a core it takes while it runs."""
        if self.computes:
            return 1.0
        return NODES_SHARE if self.kind is Kind.ROSTEST and not self.drives else DRIVES_SHARE

    @property
    def computes(self) -> bool:
        """Whether it only computes, and waits for no node by the wall clock, which would starve on a busy machine."""
        return not self.drives and self.kind is not Kind.ROSTEST and not self.name.startswith("unit/ros")


class Outcome(NamedTuple):
    """What came of a job; `trouble` says why it could not be started, or what it left behind."""

    job: Job
    passed: int
    failed: int
    skipped: int
    seconds: float
    log: str
    cpu_seconds: float = 0.0
    trouble: str = ""


def main() -> int:
    """Run what the command line asks for and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME", help="run only jobs with one of these in their name")
    parser.add_argument("--long", action="store_true", help="also what takes many minutes (sets MBF_RELAY_LONG=1)")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="jobs of system/ at a time (default: 1)")
    parser.add_argument("--results", metavar="DIR", help="folder for logs and reports, emptied first")
    parser.add_argument("--list", action="store_true", help="name the jobs and run none")
    parser.add_argument("--times", action="store_true", help="tell what the last run took its time for; run none")
    options = parser.parse_args()
    if options.jobs < 1:
        parser.error(f"--jobs is {options.jobs}; it must be at least 1")
    results = os.path.abspath(options.results or os.path.join(os.getcwd(), "test_results"))
    if options.times:
        print(job_times.table(results))
        return 0
    found = find_jobs(results)
    unknown = [name for name in options.names if not any(name in job.name for job in found)]
    jobs = [job for job in found if not options.names or any(name in job.name for name in options.names)]
    if unknown:
        print(f"no test has {' or '.join(unknown)} in its name; --list names them", file=sys.stderr)
        return 2
    if options.list:
        print("\n".join(job.name for job in jobs))
        return 0
    try:
        with only_one(results):
            return run(jobs, results, options)
    except BlockingIOError:
        print(f"another run of the tests writes to {results}; wait for it, or give another --results", file=sys.stderr)
        return 2


@contextlib.contextmanager
def only_one(results: str) -> Iterator[None]:
    """Keep another run out of a folder meanwhile; raise BlockingIOError where there is one."""
    os.makedirs(results, exist_ok=True)
    with open(os.path.join(results, ".lock"), "w", encoding="ascii") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield


def run(jobs: List[Job], results: str, options: argparse.Namespace) -> int:
    """Run jobs, their results in an emptied folder; return the exit status."""
    for folder in glob.glob(os.path.join(results, "*")):
        shutil.rmtree(folder, ignore_errors=True)
    # A shell starts what it puts in the background deaf to Ctrl-C, and nodes would inherit that; tests end them with
    # it. Whoever ends this with `timeout` means the tests.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    runner = Runner(results, long=options.long)
    start = time.monotonic()
    try:
        runner.run(jobs, workers=max(os.cpu_count() or 1, options.jobs), drives=options.jobs)
    except KeyboardInterrupt:
        runner.stop()
        print("interrupted", file=sys.stderr)
        return 130
    job_times.write(results, {o.job.name: (o.seconds, o.cpu_seconds) for o in runner.outcomes})
    return report(runner.outcomes, time.monotonic() - start)


def find_jobs(results: str) -> List[Job]:
    """Return a job for each folder of pytest files and for each .test file, in the order they are to start."""
    jobs: List[Job] = []
    for top in ("unit", "contract"):
        for folder, _, files in sorted(os.walk(os.path.join(TEST_FOLDER, top))):
            paths = sorted(os.path.join(folder, name) for name in files if re.match(r"test_.*\.py$", name))
            if paths:
                jobs.append(pytest_job(os.path.relpath(folder, TEST_FOLDER), paths, results))
    for top in ("node", "system"):
        for path in sorted(glob.glob(os.path.join(TEST_FOLDER, top, "*.test"))):
            name = os.path.relpath(path, TEST_FOLDER)
            jobs.append(Job(name, ["rostest", path], Kind.ROSTEST))
    seconds = job_times.expected(results, os.path.join(TEST_FOLDER, "README.md"))
    return sorted(find_linters() + jobs, key=lambda job: (*rank(job), -seconds.get(job.name, 0.0)))


def rank(job: Job) -> "tuple[int, bool]":
    """Return when a job starts: drives first, since they take turns, of these what goes beside no other; what computes
    while they go on; nodes, which wait. Of its kind the longest is first, since at the end it would keep a core idle.
    """
    kinds = [Kind.LINTER, Kind.PYTEST, Kind.ROSTEST]
    return -1 if job.drives else kinds.index(job.kind), job.is_patient


def pytest_job(name: str, paths: List[str], results: str) -> Job:
    """Return the job that runs some files of pytest.

    Args:
        name: Of the job.
        paths: The files.
        results: Folder for its log and report.
    """
    report_file = os.path.join(results, name, "pytest.xml")
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", f"--junit-xml={report_file}"]
    return Job(name, command + paths, Kind.PYTEST)


def find_linters() -> List[Job]:
    """Return a job for each linter; none where scripts/run has not installed them."""
    folder = os.environ.get("MBF_RELAY_LINTERS")
    if not folder:
        return []
    # what mypy remembers, by contents, spares 35 of 40 s of a core at the next run, in whichever checkout that is; two
    # that read and write it at once fall over each other, and it falls (2) over modules that only another checkout has
    cache = os.path.join(os.path.dirname(folder), "mypy_cache")
    mypy = '"$0" --cache-dir "$@" || { [ $? = 2 ] && rm -rf "$1" && "$0" --cache-dir "$@"; }'
    commands = {
        "ruff": ["ruff", "check", "--no-cache", CHECKOUT, "--config", os.path.join(CHECKOUT, ".ruff.toml")],
        "mypy": ["flock", f"{cache}.lock", "sh", "-c", mypy, "mypy", cache, "--python-executable", sys.executable,
                 "--config-file", os.path.join(CHECKOUT, ".mypy.ini")],
        "bandit": ["bandit", "-q", "-c", os.path.join(CHECKOUT, ".bandit.yaml"), "-r", os.path.join(CHECKOUT, "src")],
    }
    return [
        Job(f"lint/{name}", [os.path.join(folder, part) if part == name else part for part in command], Kind.LINTER)
        for name, command in commands.items()
    ]


class Runner:
    """Runs jobs, each in a process group and a results folder of its own, and prints a line for each."""

    def __init__(self, results: str, long: bool) -> None:
        self.outcomes: List[Outcome] = []
        self._results = results
        self._long = long
        self._lock = threading.Condition()  # notified when a job has ended
        self._waiting: List[Job] = []
        self._begun: List[Job] = []
        self._running: List[subprocess.Popen] = []
        self._threads: List[threading.Thread] = []
        self._cores = self._drives = 1
        self._stopped = False

    def run(self, jobs: List[Job], workers: int, drives: int) -> None:
        """Run the jobs, on each of `workers` cores one that computes, and return when all have ended.

        Of those that drive, and are not patient, `drives` run at a time, beside them as many more that are.
        """
        self._waiting, self._cores, self._drives = list(jobs), workers, drives
        self._threads = [threading.Thread(target=self._work, daemon=True) for _ in range(self._most())]
        for thread in self._threads:
            thread.start()
        for thread in self._threads:
            while thread.is_alive():
                thread.join(0.2)

    def stop(self) -> None:
        """End what runs, start nothing more, and return once no thread is at work.

        Python may crash that ends under one.
        """
        with self._lock:
            self._stopped = True
            self._lock.notify_all()
            running = list(self._running)
        for process in running:
            job_processes.end_group(process)
        for thread in self._threads:
            if thread.is_alive():  # the run may have been ended before this one was started
                thread.join()

    def _most(self) -> int:
        return self._cores + MORE * (self._cores > 1)

    def _may_begin(self, job: Job) -> bool:
        alike = [other for other in self._begun if other.computes == job.computes]
        if len(self._begun) >= self._most() or sum(other.share for other in alike) + job.share > self._cores:
            return False
        if not job.drives:
            return True
        driving = [other for other in alike if other.drives]
        impatient = sum(not other.is_patient for other in driving)
        return len(driving) < 2 * self._drives and (job.is_patient or impatient < self._drives)

    def _next(self) -> Optional[Job]:
        """Return the job to begin now, once there is one; None where none is left."""
        with self._lock:
            while self._waiting and not self._stopped:
                for job in self._waiting:
                    if self._may_begin(job):
                        self._waiting.remove(job)
                        self._begun.append(job)
                        return job
                self._lock.wait()
        return None

    def _work(self) -> None:
        for job in iter(self._next, None):
            log = os.path.join(self._results, job.name, "output.log")
            try:
                outcome = self._run_job(job, log)
            except OSError as error:  # there is no such program, or no room for its log
                outcome = Outcome(job, 0, 1, 0, 0.0, log, trouble=str(error))
            with self._lock:
                self._begun.remove(job)
                self._lock.notify_all()
                if outcome is None or self._stopped:
                    return
                self.outcomes.append(outcome)
                words = "FAILED" if outcome.failed else "passed"
                print(f"{words}  {job.name}: {counts(outcome)} in {outcome.seconds:.1f} s", flush=True)

    def _run_job(self, job: Job, log: str) -> Optional[Outcome]:
        folder = os.path.dirname(log)
        os.makedirs(folder, exist_ok=True)
        start = time.monotonic()
        with open(log, "wb") as stream:
            with self._lock:
                if self._stopped:
                    return None
                process = subprocess.Popen(
                    job.command,
                    cwd=CHECKOUT if job.kind is Kind.LINTER else folder,
                    env=self._environment(folder),
                    stdout=stream,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )
                self._running.append(process)
            if job.computes:
                job_processes.give_way(process)
            try:
                cpu_seconds = job_times.wait(process, TIME_LIMIT * (LONGER if self._long else 1))
            except subprocess.TimeoutExpired:
                cpu_seconds = 0.0
                stream.write(f"\nended after {time.monotonic() - start:.0f} s\n".encode())
        job_processes.end_group(process)
        left = job_processes.end_what_is_left(process.pid)
        with self._lock:
            self._running.remove(process)
        report_file = os.path.join(folder, "pytest.xml")
        if job.kind is Kind.LINTER:
            passed, failed, skipped = int(process.returncode == 0), int(process.returncode != 0), 0
        else:
            passed, failed, skipped = (
                job_reports.of_rostest(log) if job.kind is Kind.ROSTEST else job_reports.of_pytest(report_file))
        if (process.returncode != 0 or left) and failed == 0:
            failed = 1
        return Outcome(job, passed, failed, skipped, time.monotonic() - start, log, cpu_seconds, left)

    def _environment(self, folder: str) -> Dict[str, str]:
        environment = dict(os.environ, ROS_LOG_DIR=os.path.join(folder, "log"), ROS_TEST_RESULTS_DIR=folder)
        # The built package goes before the source, which has no mbf_relay.cfg.
        paths = [TEST_FOLDER, environment.get("PYTHONPATH", ""), os.path.join(CHECKOUT, "src")]
        environment["PYTHONPATH"] = os.pathsep.join(path for path in paths if path)
        environment.update(MBF_RELAY_TEST_RESULTS=folder, MPLBACKEND="Agg")
        environment["ROS_ETC_DIR"] = os.path.join(TEST_FOLDER, "roscore")
        environment["OPENBLAS_NUM_THREADS"] = "1"  # as nodes have it: more of them spin after each small matrix
        if self._long:
            environment["MBF_RELAY_LONG"] = "1"
        return environment


def counts(outcome: Outcome) -> str:
    """Return a job's numbers in words."""
    words = f"{outcome.passed} passed"
    if outcome.failed:
        words += f", {outcome.failed} failed"
    return words + (f", {outcome.skipped} skipped" if outcome.skipped else "")


def report(outcomes: List[Outcome], seconds: float) -> int:
    """Print the failures' logs and the last line; return the exit status."""
    failures = [outcome for outcome in outcomes if outcome.failed]
    for outcome in failures:
        folder = os.path.dirname(outcome.log)
        print(f"\n=== {outcome.job.name} failed (all of it: {folder}) === {outcome.trouble}")
        # What a rostest's own process prints does not go to rostest's output but beside the nodes' logs.
        for log in glob.glob(outcome.log) + glob.glob(os.path.join(folder, "log", "*-*", "*-stdout.log")):
            with open(log, encoding="utf-8", errors="replace") as stream:
                print("\n".join(stream.read().splitlines()[-40:]))
    passed, failed = sum(o.passed for o in outcomes), sum(o.failed for o in outcomes)
    skipped = sum(o.skipped for o in outcomes)
    slowest = sorted(outcomes, key=lambda outcome: -outcome.seconds)[:SLOWEST]
    if len(outcomes) > SLOWEST:
        print("\nlongest: " + ", ".join(f"{outcome.job.name} {outcome.seconds:.0f} s" for outcome in slowest)
              + "; scripts/test --times tells more")
    computed = sum(o.cpu_seconds for o in outcomes) / 60
    print(f"\n{len(outcomes)} jobs in {seconds:.0f} s, which computed {computed:.1f} min"
          + (f", {skipped} tests skipped" if skipped else ""))
    print(f"{passed} passed, {failed} failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

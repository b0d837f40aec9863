"""What was tried to leave a robot driving for nobody, how often, and what was lost: the proof behind "safe".

The proofs are tests, each named after what a robot would have suffered, which `scripts/test --long` runs too; here they
are run one after the other and what they tell of their trials is counted. A trial is lost where its test fails.

All of it takes hours. What was run in pieces before, each with MBF_RELAY_TEST_RESULTS in a folder of its own, is
counted with it where MBF_RELAY_TOLD names the folder that these lie in; of one tree, or the figures mean nothing. With
MBF_RELAY_SHARE=0 these alone are counted, and nothing is run.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Dict, Iterator, List, NamedTuple, Tuple

import run_all
from tally import FILE, Trial, read_trials, share

from benchmark.metric import Metric, NotMeasurable, metric_of
from benchmark.report import LOST

HERE = Path(__file__).resolve().parents[1]


class Proof(NamedTuple):
    """A test that tries something often.

    Attributes:
        what: It tries; its own tests count as trials where they tell of none.
        where: Its file, below this folder's parent.
    """

    what: str
    where: str


PROOFS = (
    Proof("nodes killed and frozen", "system/pulled_nodes.test"),
    Proof("simulator killed and frozen", "system/pulled_simulator.test"),
    Proof("master killed and frozen", "system/pulled_master.test"),
    Proof("goals cancelled, replaced, orphaned, in crowds", "node/goal_trials.test"),
    Proof("model of a goal's life", "unit/ros/relay/test_goal_life.py"),
    Proof("drives whose sensors, odometry, commands or clock fail", "unit/lockstep/test_faulty_drives.py"),
    Proof("clocks set while the robot drives", "system/clock_steps.test"),
    Proof("strangers on /clock", "system/attacked_clock.test"),
    Proof("things set down", "unit/lockstep/test_things_set_down.py"),
    Proof("goals one after the other", "system/soak.test"),
    Proof("messages of any kind converted", "unit/ros/common/test_fuzzed_messages.py"),
    Proof("messages of any kind sent to a server that drives", "node/garbage.test"),
    Proof("services and reconfiguring", "system/fuzzed_services.test"),
    Proof("parameters", "unit/test_fuzzed_parameters.py"),
    Proof("starts of a node with one parameter of any kind", "unit/ros/test_fuzzed_starts.py"),
    Proof("broken files", "unit/test_files.py"),
    Proof("nodes ended by a signal while they start or run", "unit/ros/common/test_ending.py"),
    Proof("a machine of a tenth of a core", "system/slow_machine.test"),
)


def metrics(quick: bool) -> Iterator[Metric]:
    """Run every proof, in its short form or as often as its claim asks for, and count."""
    if shutil.which("rostest") is None:
        raise NotMeasurable("there is no ROS here")
    results = tempfile.mkdtemp(prefix="reliability-")
    lost, loads = False, []
    told = told_before(os.environ.get("MBF_RELAY_TOLD", ""))
    try:
        for proof in PROOFS if share() > 0.0 else ():
            for metric in count(proof, results, quick, told):
                lost = lost or (metric.name.endswith(LOST) and metric.value > 0)
                yield metric
            loads.append(os.getloadavg()[0])
        for what, trials in sorted(told.items()):
            lost = lost or any(trial.lost for trial in trials)
            yield from tried(what, trials)
        if loads:
            yield metric_of("load average of the machine", loads, "", cores=os.cpu_count())
    finally:
        if lost:
            print(f"the logs of what was lost are in {results}", file=sys.stderr)
        else:
            shutil.rmtree(results)


def told_before(folder: str) -> Dict[str, List[Trial]]:
    """Return the trials told of anywhere below a folder, by what they tried; none for an empty name."""
    found: Dict[str, List[Trial]] = {}
    for path in sorted(Path(folder).rglob(FILE)) if folder else ():
        for trial in read_trials(path.parent):
            found.setdefault(trial.what, []).append(trial)
    return found


def count(proof: Proof, results: str, quick: bool, told: Dict[str, List[Trial]]) -> Iterator[Metric]:
    """Run a proof's tests and tell what was tried and lost, and what its trials measured.

    Args:
        proof: To run.
        results: Folder for its logs.
        quick: Whether to run its short form.
        told: What was tried before, by what; taken from where it is counted with what is tried now.
    """
    runner = run_all.Runner(results, long=not quick)
    runner.run([job_of(proof, results)], workers=1, drives=1)
    outcome = runner.outcomes[0]
    by_name: Dict[str, List[Trial]] = {}
    for trial in read_trials(Path(outcome.log).parent):
        by_name.setdefault(trial.what, []).append(trial)
    lost_trials = sum(trial.lost for trials in by_name.values() for trial in trials)
    run = outcome.passed + outcome.failed  # none where all are skipped
    if run and (not by_name or outcome.failed > lost_trials):  # of tests that tell of no trials, or failed beside them
        yield counted(proof.what, outcome.failed - lost_trials, run, "tests")
    for what, trials in sorted(by_name.items()):
        yield from tried(what, told.pop(what, []) + trials)


def tried(what: str, trials: List[Trial]) -> Iterator[Metric]:
    """Tell how many trials there were, how many were lost, and what they measured."""
    yield counted(what, sum(trial.lost for trial in trials), len(trials), "trials")
    yield from measured(what, trials)


def counted(what: str, lost: int, tried: int, unit: str) -> Metric:
    """Return how many of so many were lost."""
    return Metric(f"{what}{LOST}", float(lost), repeats=tried, parameters={unit: tried})


def measured(what: str, trials: List[Trial]) -> Iterator[Metric]:
    """Tell the median and the largest of what was measured in the trials."""
    samples: Dict[Tuple[str, str], List[float]] = {}
    for name, value, unit in (each for trial in trials for each in trial.measured):
        samples.setdefault((name, unit), []).append(value)
    for (name, unit), values in samples.items():
        yield metric_of(f"{what}: {name}", values, unit)
        if len(values) > 1:
            yield Metric(f"{what}: {name}, longest", max(values), unit, repeats=len(values))


def job_of(proof: Proof, results: str) -> run_all.Job:
    """Return the job that runs a proof's tests alone."""
    path = HERE / proof.where
    if path.suffix == ".test":
        return run_all.Job(path.name, ["rostest", str(path)], run_all.Kind.ROSTEST)
    return run_all.pytest_job(path.name, [str(path)], results)

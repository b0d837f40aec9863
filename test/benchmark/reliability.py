"""What was tried to leave a robot driving for nobody, how often, and what was lost: the proof behind "safe"."""

from __future__ import annotations

import itertools
import math
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Iterable, Iterator, List

from benchmark.metric import Metric, NotMeasurable, metric_of
from benchmark.processes import node_pid, resident_bytes

SEED = 1
CANCELS, QUICK_CANCELS = 5000, 50
CANCEL_WITHIN = 0.5
"""Time (s) from goal to cancel at most."""
LOSSES, QUICK_LOSSES = 25, 1
"""Kills, and stops, of relay and of server each."""
REPLACED, QUICK_REPLACED = 200, 11
CROWD, RATE, CROWD_TIME, QUICK_CROWD_TIME = 20, 20.0, 120.0, 3.0
RUNS, QUICK_RUNS = 10_000, 50
MODEL = Path(__file__).resolve().parents[1] / "unit" / "ros" / "relay" / "test_goal_life.py"


def metrics(quick: bool) -> Iterator[Metric]:
    """Try everything and count."""
    if shutil.which("roscore") is None:
        raise NotMeasurable("there is no ROS here")
    yield _model(QUICK_RUNS if quick else RUNS)
    from mbf_relay.ros.tools.demo_graph import Graph

    with tempfile.TemporaryDirectory() as folder, Graph([_bare_graph(folder)], folder) as graph:
        os.environ.update(graph.environment)
        graph.wait_for_parameter("/run_id", 60.0)
        import rospy
        from node.goal_trials import GoalTrials

        rospy.init_node("reliability", anonymous=True, disable_signals=True)
        trials = GoalTrials()
        try:
            yield from _trials(trials, quick)
        finally:
            trials.close()
            rospy.signal_shutdown("measured")


def _bare_graph(folder: str) -> str:
    """Write a launch file that gives a master and little else; relay and server are the trials' own, who kill them."""
    path = Path(folder) / "bare.launch"
    path.write_text('<launch><node pkg="rosout" type="rosout" name="keeper"/></launch>', encoding="utf-8")
    return str(path)


def _model(runs: int) -> Metric:
    """Check the model of a goal's life; its tests fail where a goal has two ends or a robot drives for nobody."""
    environment = dict(os.environ, MBF_RELAY_RUNS=str(runs))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(MODEL)]
    failed = subprocess.run(command, env=environment, stdout=subprocess.DEVNULL).returncode != 0
    return Metric("model of a goal's life, lost", float(failed), repeats=1, parameters={"runs": runs})


def _trials(trials: Any, quick: bool) -> Iterator[Metric]:
    from node.goal_trials import BROKEN, FACES

    rng = random.Random(SEED)  # noqa: S311 (moments of cancels)
    cancels, losses, replaced = (
        (QUICK_CANCELS, QUICK_LOSSES, QUICK_REPLACED) if quick else (CANCELS, LOSSES, REPLACED))
    moments = [(face, rng.uniform(0.0, CANCEL_WITHIN)) for face, _ in zip(itertools.cycle(FACES), range(cancels))]
    yield from _tell("goals cancelled at 0 to 500 ms", (trials.cancel(*moment) for moment in moments))
    kinds = itertools.islice(itertools.cycle(BROKEN), replaced)
    yield from _tell("drives replaced by a broken goal", (trials.replace(kind) for kind in kinds))
    for what, lose in (("relay", trials.orphan), ("server", trials.lose_server)):
        for how in (signal.SIGKILL, signal.SIGSTOP):
            word = "killed" if how is signal.SIGKILL else "stopped"
            orphaned = what == "relay" and how is signal.SIGKILL
            yield from _tell(f"{what} {word} in a drive", (lose(how) for _ in range(losses)), 0 if orphaned else 1)
    pid = node_pid("/move_base", "/reliability")  # where goals were many, memory shows what is kept of them
    before = resident_bytes(pid)
    counts = trials.crowd(CROWD, RATE, QUICK_CROWD_TIME if quick else CROWD_TIME)
    goals, lost = sum(counts.values()), counts.get("LOST", 0) + counts.get("never ended", 0)
    yield Metric("goals of stock clients, lost", lost, repeats=goals, parameters={"clients": CROWD, "rate_hz": RATE})
    yield Metric(
        "memory the relay grew by", (resident_bytes(pid) - before) / 2.0**20, "MiB", parameters={"goals": goals}
    )


def _tell(name: str, made: Iterable[Any], results: int = 1) -> Iterator[Metric]:
    """Tell how often something was tried, what was lost, and how long the robots drove on.

    Args:
        name: Of what was tried.
        made: The trials.
        results: Number of results that each goal must have.
    """
    trials: List[Any] = list(made)
    lost = [t for t in trials if len(t.states) != results or t.went_on or not math.isfinite(t.stopped_after)]
    yield Metric(f"{name}, lost", float(len(lost)), repeats=len(trials))
    yield metric_of(f"{name}, last velocity after", [1e3 * trial.stopped_after for trial in trials], "ms")
    yield Metric(f"{name}, longest", 1e3 * max(trial.stopped_after for trial in trials), "ms", repeats=len(trials))

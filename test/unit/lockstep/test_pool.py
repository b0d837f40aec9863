"""The pool: results, tasks that throw, die or hang, and interrupts."""

import os
import signal
import threading
import time

import pytest

from mbf_relay.lockstep.pool import Pool


def act(task):
    """Do what a task says."""
    if task == "throw":
        raise ValueError("a plugin's mistake")
    if task == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if task == "hang":
        threading.Event().wait(600.0)
    if task == "threads":
        return os.environ["OPENBLAS_NUM_THREADS"]
    return task * 2


def test_results_come_with_their_tasks():
    ended = {task: result for task, result, lost in Pool(act, 2, 60.0).run([1, 2, 3, 4]) if lost is None}
    assert ended == {1: 2, 2: 4, 3: 6, 4: 8}


def test_a_task_that_throws_dies_or_hangs_costs_only_itself():
    lost = {}
    results = {}
    for task, result, loss in Pool(act, 2, 3.0).run(["throw", 1, "die", 2, "hang", 3]):
        if loss is None:
            results[task] = result
        else:
            lost[task] = str(loss)
    assert results == {1: 2, 2: 4, 3: 6}
    assert "ValueError: a plugin's mistake" in lost["throw"]
    assert "SIGKILL" in lost["die"]
    assert "hung" in lost["hang"]


def test_processes_get_one_thread_each_and_this_one_keeps_its_own(monkeypatch):
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    assert [result for _, result, _ in Pool(act, 1, 60.0).run(["threads"])] == ["1"]
    assert "OPENBLAS_NUM_THREADS" not in os.environ


def test_closing_ends_the_processes():
    running = Pool(act, 1, 60.0).run([1, "hang"])
    assert next(running)[1] == 2
    started = time.perf_counter()
    running.close()
    assert time.perf_counter() - started < 10.0


def test_no_jobs_is_an_error():
    with pytest.raises(ValueError, match="--jobs is 0"):
        Pool(act, 0, 1.0)

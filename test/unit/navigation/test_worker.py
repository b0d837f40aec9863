"""Workers: what a task returns or raises, on whose thread, and that one that hangs stops nobody."""

import threading

import pytest

from mbf_relay.navigation import worker as worker_module
from mbf_relay.navigation.worker import InlineWorker, ThreadWorker

WAIT = 10.0


def test_inline_a_job_is_done_at_once():
    job = InlineWorker().start(lambda: threading.current_thread())
    assert job.done and job.result() is threading.current_thread()


def test_what_a_task_raises_is_raised_to_whoever_asks():
    job = InlineWorker().start(lambda: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        job.result()


def test_a_task_that_exits_ends_its_job_alone():
    with pytest.raises(RuntimeError, match="SystemExit: 3"):
        InlineWorker().start(lambda: exit(3)).result()


def test_an_interrupt_of_the_user_is_no_plugin_s_failure():
    def interrupted():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        InlineWorker().start(interrupted)


def test_threads_run_beside_each_other_and_tell_when_done():
    done, release = threading.Semaphore(0), threading.Event()
    worker = ThreadWorker(done.release)
    hanging = worker.start(lambda: release.wait(WAIT))
    jobs = [worker.start(lambda value=value: value) for value in range(20)]
    for _ in jobs:
        assert done.acquire(timeout=WAIT)
    assert [job.result() for job in jobs] == list(range(20)) and not hanging.done
    with pytest.raises(RuntimeError, match="still running"):
        hanging.result()
    release.set()
    assert done.acquire(timeout=WAIT) and hanging.result()


def test_threads_are_used_again():
    done = threading.Semaphore(0)
    worker = ThreadWorker(done.release)
    threads = set()
    for _ in range(50):
        worker.start(lambda: threads.add(threading.current_thread()))
        assert done.acquire(timeout=WAIT)
    assert len(threads) <= 2


def test_a_plan_and_a_velocity_wait_for_no_thread_that_a_busy_system_is_slow_to_make(monkeypatch):
    """The first goal beside RViz's start ended: making the planner's thread took the system more than a second."""
    done, both = threading.Semaphore(0), threading.Barrier(2)
    worker = ThreadWorker(done.release)

    def hangs(_thread):
        raise AssertionError("a thread was made for it")

    monkeypatch.setattr(threading.Thread, "start", hangs)
    jobs = [worker.start(lambda: both.wait(WAIT)) for _ in range(2)]
    for _ in jobs:
        assert done.acquire(timeout=WAIT)
    assert sorted(job.result() for job in jobs) == [0, 1]


def test_a_goal_that_no_thread_is_left_for_ends_and_the_next_is_driven(monkeypatch):
    done, ran = threading.Semaphore(0), []
    monkeypatch.setattr(worker_module, "READY", 0)
    worker = ThreadWorker(done.release)

    def fails(_thread):
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", fails)
        job = worker.start(lambda: ran.append("first"))
    assert job.done and done.acquire(timeout=WAIT)
    with pytest.raises(RuntimeError, match="can't start new thread"):
        job.result()
    worker.start(lambda: ran.append("second"))
    assert done.acquire(timeout=WAIT)
    assert ran == ["second"]

"""The order in which tests run, what is told of the time they took, and that they end with who runs them."""

import pathlib
import re
import signal
import subprocess
import sys
import threading
from types import SimpleNamespace

import job_processes
import job_times
import psutil
import pytest
import run_all
from ros_testing import wait_until
from run_all import Job, Kind, Runner, find_jobs

ALONE = """
import os, sys
os.mkdir(sys.argv[1])  # fails where another one drives
os.rmdir(sys.argv[1])
"""
MEET = """
import pathlib, sys, threading, time
mine, *others = (pathlib.Path(name) for name in sys.argv[1:])
mine.touch()
end = time.monotonic() + 60.0
while not all(other.exists() for other in others) and time.monotonic() < end:
    threading.Event().wait(0.01)
met = all(other.exists() for other in others)
mine.write_text("met" if met else "alone")
sys.exit(not met)
"""


def job(name, code, *arguments):
    return Job(name, [sys.executable, "-c", code, *(str(argument) for argument in arguments)], Kind.LINTER)


def failed(tmp_path, jobs, workers):
    runner = Runner(str(tmp_path), long=False)
    runner.run(jobs, workers=workers, drives=1)
    assert sorted(outcome.job.name for outcome in runner.outcomes) == sorted(job.name for job in jobs)
    return [outcome.job.name for outcome in runner.outcomes if outcome.failed]


def test_a_job_whose_program_is_not_there_has_failed_and_the_others_run(tmp_path, capsys):
    """The thread that was to start it ended; without rostest nothing ran at all, and the status was 0."""
    lacking = [Job(f"node/{number}.test", ["rostest that nobody installed"], Kind.ROSTEST) for number in range(5)]
    jobs = [*lacking, job("unit", "pass")]
    assert failed(tmp_path, jobs, workers=1) == [each.name for each in lacking]
    assert run_all.run(jobs, str(tmp_path / "results"), SimpleNamespace(long=False, jobs=1)) == 1
    told = capsys.readouterr().out
    assert "1 passed, 5 failed" in told and "rostest that nobody installed" in told


LEAVES = """
import subprocess, sys
subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)", sys.argv[1]])
"""


def test_a_test_that_leaves_something_running_has_failed_and_it_is_ended(tmp_path, monkeypatch, capsys):
    """A setup that waited for RViz in vain left it and its screen behind, and both went on drawing for half an hour."""
    monkeypatch.setattr(job_processes, "PATIENCE", 0.5)
    jobs = [job("unit", LEAVES, tmp_path)]
    assert run_all.run(jobs, str(tmp_path / "results"), SimpleNamespace(long=False, jobs=1)) == 1
    assert "0 failed" not in capsys.readouterr().out
    cmdlines = [process.info["cmdline"] or [] for process in psutil.process_iter(["cmdline"])]
    assert not [cmdline for cmdline in cmdlines if cmdline[-1:] == [str(tmp_path)]]


def test_robots_that_drive_in_real_time_never_share_the_machine(tmp_path):
    jobs = [job(f"system/{number}", ALONE, tmp_path / "road") for number in range(6)]
    assert failed(tmp_path, jobs, workers=3) == []


def test_a_drive_leaves_no_core_idle_while_there_is_something_to_compute(tmp_path):
    pair = [tmp_path / "drives", tmp_path / "computes"]
    jobs = [job("system/a", MEET, *pair), job("system/b", ALONE, tmp_path / "road"), job("unit", MEET, *pair[::-1])]
    assert failed(tmp_path, jobs, workers=2) == []


def test_beside_a_drive_each_core_has_something_to_compute(tmp_path):
    names = ["system/a", "unit/a", "unit/b"]
    places = [tmp_path / name.replace("/", "-") for name in names]
    jobs = [job(name, MEET, *places[index:], *places[:index]) for index, name in enumerate(names)]
    jobs += [job("system/b", ALONE, tmp_path / "road"), job("unit/c", ALONE, tmp_path / "third")]
    assert failed(tmp_path, jobs, workers=2) == []


def test_two_robots_whose_simulators_wait_for_them_drive_beside_each_other(tmp_path):
    pair = [tmp_path / "one", tmp_path / "other"]
    jobs = [job("system/circle.test", MEET, *pair), job("system/goals.test", MEET, *pair[::-1])]
    assert failed(tmp_path, jobs, workers=2) == []


def test_a_robot_whose_time_matters_drives_beside_one_that_waits_and_beside_no_other(tmp_path):
    pair, road = [tmp_path / "one", tmp_path / "other"], tmp_path / "road"
    jobs = [job("system/a", ALONE, road), job("system/b", ALONE, road), job("system/c", MEET, *pair)]
    jobs.append(job("system/goals.test", MEET, *pair[::-1]))
    assert failed(tmp_path, jobs, workers=2) == []


def test_folders_whose_tests_wait_for_nodes_run_side_by_side_while_single_nodes_do(tmp_path):
    """They were last, when nothing was left to compute, and a core was idle."""
    names = ["unit/ros", "unit/ros/common", "node/a.test", "node/b.test"]
    places = [tmp_path / name.replace("/", "-") for name in names]
    jobs = [
        Job(name, [sys.executable, "-c", MEET, *map(str, (*places[index:], *places[:index]))],
            Kind.ROSTEST if name.startswith("node") else Kind.PYTEST)
        for index, name in enumerate(names)]
    runner = Runner(str(tmp_path), long=False)
    runner.run(jobs[2:] + jobs[:2], workers=2, drives=1)
    assert [place.read_text() for place in places] == ["met"] * len(names)


@pytest.mark.parametrize("more", [["--list"], []])
def test_a_misspelt_job_among_several_is_not_left_out_in_silence(tmp_path, monkeypatch, capsys, more):
    """The rest ran and passed, and a CI was green without the tests it was there for."""
    monkeypatch.setattr(sys, "argv", ["run_all.py", "--results", str(tmp_path), "unit/control", "unit/planing", *more])
    monkeypatch.setattr(run_all, "run", lambda *_arguments: 0)
    assert run_all.main() == 2
    assert "no test has unit/planing in its name" in capsys.readouterr().err


@pytest.mark.parametrize("name", run_all.PATIENT)
def test_a_robot_that_drives_beside_another_one_has_a_simulator_that_waits(name):
    text = (pathlib.Path(run_all.TEST_FOLDER) / "system" / f"{name}.test").read_text(encoding="utf-8")
    own = name in ("demo", "readme_commands", "users_launch_files")  # start what waits by themselves
    waits = re.search(r'name="command_patience" value="[1-9]', text) or "launch/demo.launch" in text or own
    assert waits and not re.search(r'name="command_patience" value="0', text)


def test_what_takes_long_starts_before_others_of_its_kind(tmp_path):
    def names():
        return [job.name for job in find_jobs(str(tmp_path)) if job.computes and job.kind is Kind.PYTEST]

    usual = names()
    assert usual.index("unit/lockstep") < usual.index("unit/view")  # by the table, where nothing has run yet
    job_times.write(str(tmp_path), {"unit/view": (9999.0, 1.0), "unit/lockstep": (1.0, 1.0)})
    assert names()[0] == "unit/view"


def test_on_one_core_everything_runs_one_after_the_other(tmp_path):
    jobs = [job(name, ALONE, tmp_path / "core") for name in ("system/a", "unit", "system/b", "node/c.test")]
    assert failed(tmp_path, jobs, workers=1) == []


def test_drives_start_first_and_what_computes_goes_beside_them(tmp_path):
    kinds = ["drive" if job.drives else job.kind.name for job in find_jobs(str(tmp_path)) if job.kind != Kind.LINTER]
    assert list(dict.fromkeys(kinds)) == ["drive", "PYTEST", "ROSTEST"]


def test_the_longest_tests_are_named(tmp_path):
    report = tmp_path / "unit" / "pytest.xml"
    report.parent.mkdir()
    report.write_text('<testsuites><testsuite><testcase name="short" time="0.1"/><testcase name="long" time="7.2"/>'
                      '</testsuite></testsuites>')
    job_times.write(str(tmp_path), {"node/relay.test": (2.0, 1.0), "unit": (8.0, 6.0)})
    assert job_times.table(str(tmp_path)).splitlines()[2:] == [
        "| unit | 8 | 6 | long 7 |", "| node/relay.test | 2 | 1 |  |", "| sum | 10 | 7 | |",
    ]


def test_what_the_children_of_a_job_compute_is_counted(tmp_path):
    compute = "import time\nwhile time.process_time() < 0.5: pass"
    child = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {compute!r}], check=True)"
    runner = Runner(str(tmp_path), long=False)
    runner.run([job("unit", child)], workers=1, drives=1)
    assert runner.outcomes[0].cpu_seconds >= 0.5


def test_a_job_that_waits_for_a_core_is_not_ended_as_one_that_hangs(monkeypatch):
    """On a machine with much else to do the longest folder of unit tests was ended half way."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        with pytest.raises(subprocess.TimeoutExpired):
            job_times.wait(process, 0.0)
        looks = []

        def starved(pid):
            looks.append(pid)
            if len(looks) == 3:
                process.stdin.close()
            return 1e9

        monkeypatch.setattr(job_times, "waited_for_a_core", starved)
        job_times.wait(process, 0.0)
        assert set(looks) == {process.pid} and len(looks) >= 3


def test_a_second_run_does_not_empty_the_folder_that_a_first_one_writes_to(tmp_path, monkeypatch, capsys):
    """The reports of the first were gone before they were read, and its jobs counted as failed."""
    (tmp_path / "unit").mkdir()
    monkeypatch.setattr(sys, "argv", ["run_all.py", "--results", str(tmp_path), "unit/scripts"])
    with run_all.only_one(str(tmp_path)):
        assert run_all.main() == 2
    assert "another run of the tests writes to" in capsys.readouterr().err and (tmp_path / "unit").is_dir()
    with run_all.only_one(str(tmp_path)):
        pass


def test_who_interrupts_a_run_is_told_that_and_sees_no_traceback_of_jobs_that_were_ended():
    process = subprocess.Popen([sys.executable, "-c", "pass"])
    process.wait()  # as who interrupts does, before the thread whose job it is
    assert job_times.wait(process, 60.0) == 0.0


def test_without_a_run_there_is_nothing_to_tell(tmp_path):
    assert "no run" in job_times.table(str(tmp_path))


def test_nothing_is_at_work_for_a_run_once_it_was_ended(tmp_path, monkeypatch):
    """Python ended under the threads that looked for what jobs had left, and the run with a segmentation fault."""
    ending, ended, look = threading.Event(), [], job_processes.end_what_is_left

    def look_late(group):
        ending.wait(60.0)
        ended.append(look(group))

    monkeypatch.setattr(job_processes, "end_what_is_left", look_late)
    runner = Runner(str(tmp_path), long=False)
    running = threading.Thread(target=runner.run, args=([job("unit", "input()")],), kwargs={"workers": 1, "drives": 1})
    running.start()
    wait_until(lambda: runner._running, "the job")
    stopping = threading.Thread(target=runner.stop)
    stopping.start()
    stopping.join(0.5)
    assert stopping.is_alive(), "it waits for what is at work"
    ending.set()
    stopping.join(60.0)
    running.join(60.0)
    assert ended == [""] and runner.outcomes == []


def test_a_run_that_is_interrupted_as_it_begins_ends_as_any_other(tmp_path, monkeypatch):
    begun, start = [], threading.Thread.start

    def interrupted(thread):
        if begun:
            raise KeyboardInterrupt
        begun.append(thread)
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", interrupted)
    results = str(tmp_path / "results")
    assert run_all.run([job("unit", "input()")], results, SimpleNamespace(long=False, jobs=2)) == 130
    assert not begun[0].is_alive()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_no_test_drives_on_when_the_runner_is_ended(tmp_path, number):
    runner = subprocess.Popen(
        [sys.executable, run_all.__file__, "--results", str(tmp_path), "unit/localization"], stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL)
    started = psutil.Process(runner.pid)
    wait_until(lambda: (tmp_path / "unit/localization/output.log").exists() and started.children(), "a job", 60.0)
    jobs = started.children(recursive=True)
    runner.send_signal(number)
    try:
        assert runner.wait(60.0) == 130
        wait_until(lambda: not any(job.is_running() for job in jobs), "the end of what it started", 60.0)
    finally:
        for process in [runner, *(job for job in jobs if job.is_running())]:
            process.kill()
        runner.wait()

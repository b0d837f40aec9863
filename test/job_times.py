"""What a run of the tests took its time for: each job, what it computed, and the tests in it that took longest."""

import glob
import json
import os
import re
import subprocess
import threading
import time
import xml.etree.ElementTree as ElementTree
from typing import Dict, List, Tuple

FILE = "seconds.json"
ROW = r"^\| ([a-z_]+(?:/[a-z_.]+)*) \| (\d+) \| \d+ \|"
"""The first columns of a row of the table: a job and its seconds."""
TOLD = 3
"""Tests named for each job."""
SHORTEST = 0.5
"""Seconds below which a test is not named."""
LONGEST_NAME = 100
"""Letters of a test's name; some are given what they are to read."""
_PAUSE = threading.Event()


def wait(process: subprocess.Popen, timeout: float) -> float:
    """Wait until a process has ended; return the seconds that it and what it waited for have computed.

    Raises:
        subprocess.TimeoutExpired: It has not, after `timeout` seconds of the wall clock, not counting those in which it
            would have computed and had no core: what gives way to drives is not ended for that.
    """
    end = time.monotonic() + timeout
    try:
        while os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG) is None:
            now = time.monotonic()
            if now >= end and now >= end + waited_for_a_core(process.pid):
                raise subprocess.TimeoutExpired(process.args, timeout)
            _PAUSE.wait(0.05)
        with open(f"/proc/{process.pid}/stat", encoding="utf-8", errors="replace") as stream:
            ticks = stream.read().rpartition(")")[2].split()[11:15]  # utime, stime, and both of its children
    except (ChildProcessError, FileNotFoundError):  # who interrupts the run has ended it, and waited for it
        ticks = []
    process.wait()
    return sum(int(each) for each in ticks) / os.sysconf("SC_CLK_TCK")


def waited_for_a_core(pid: int) -> float:
    """Return the seconds in which the first thread of a process could have run and did not; 0 where nobody counts."""
    try:
        with open(f"/proc/{pid}/schedstat", encoding="ascii") as stream:
            return int(stream.read().split()[1]) * 1e-9
    except (OSError, IndexError, ValueError):
        return 0.0


def expected(results: str, readme: str) -> Dict[str, float]:
    """Return the seconds each job is likely to take: those of the last run here, else those of the table in `readme`.
    """
    with open(readme, encoding="utf-8") as stream:
        known = {name: float(seconds) for name, seconds in re.findall(ROW, stream.read(), re.MULTILINE)}
    try:
        return {**known, **{name: each[0] for name, each in _read(results).items()}}
    except (OSError, ValueError):
        return known


def _read(results: str) -> Dict[str, Tuple[float, float]]:
    with open(os.path.join(results, FILE), encoding="utf-8") as stream:
        seconds: Dict[str, Tuple[float, float]] = json.load(stream)
    return seconds


def write(results: str, seconds: Dict[str, Tuple[float, float]]) -> None:
    """Leave what `table` reads: the seconds of each job and those it computed, beside the reports of its tests."""
    with open(os.path.join(results, FILE), "w", encoding="utf-8") as stream:
        json.dump(seconds, stream, indent=1)


def table(results: str) -> str:
    """Return the table of the last run in Markdown, the longest job first."""
    try:
        seconds = _read(results)
    except OSError as error:
        return f"no run of the tests has ended here yet: {error}"
    rows = ["| job | s | computing, s | its longest tests (s) |", "|---|---|---|---|"]
    for job in sorted(seconds, key=lambda name: -seconds[name][0]):
        longest = sorted(tests(os.path.join(results, job)), reverse=True)[:TOLD]
        words = ", ".join(f"{name} {time:.0f}" for time, name in longest if time >= SHORTEST)
        rows.append(f"| {job} | {seconds[job][0]:.0f} | {seconds[job][1]:.0f} | {words} |")
    lasted, computed = (sum(each) for each in zip(*seconds.values()))
    rows.append(f"| sum | {lasted:.0f} | {computed:.0f} | |")
    return "\n".join(rows)


def tests(folder: str) -> List[Tuple[float, str]]:
    """Return the seconds and the name of each test that left a report in a job's folder."""
    # a rostest's own report counts as one test what is a report of many beside it
    paths = glob.glob(os.path.join(folder, "pytest.xml")) + glob.glob(os.path.join(folder, "*", "rosunit-*.xml"))
    found = []
    for path in paths:
        try:
            root = ElementTree.parse(path).getroot()
        except (OSError, ElementTree.ParseError):  # of a test that was ended
            continue
        for case in root.iter("testcase"):
            found.append((float(case.get("time") or 0.0), case.get("name", "")[:LONGEST_NAME]))
    return found

"""Processes: what a node's costs, and one of a measurement's own."""

from __future__ import annotations

import os
import subprocess
import sys
import xmlrpc.client
from pathlib import Path
from typing import Dict

import psutil

from mbf_relay.lockstep.driver import path_of_processes


def told_by(code: str) -> str:
    """Return what some code prints in a Python started for it, which finds every module that this one does."""
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join(path_of_processes()))
    return subprocess.run(
        [sys.executable, "-c", code], check=True, stdout=subprocess.PIPE, text=True, env=environment
    ).stdout


def node_pid(node: str, asker: str) -> int:
    """Return the process of a running node; `asker` is the name of who asks."""
    import rosgraph

    uri = rosgraph.Master(asker).lookupNode(node)
    return int(xmlrpc.client.ServerProxy(uri).getPid(asker)[2])  # type: ignore[index, arg-type]


def cpu_seconds(pid: int) -> float:
    """Return the processor time (s) a process has used, and those it started that have ended."""
    times = psutil.Process(pid).cpu_times()
    return float(times.user + times.system + times.children_user + times.children_system)


def resident_bytes(pid: int) -> int:
    """Return the memory a process holds."""
    return int(psutil.Process(pid).memory_info().rss)


def memory_mebibytes(pid: int) -> Dict[str, float]:
    """Return the memory (MiB) of a process: resident, its share where it is shared, and what is its own alone."""
    names = {"Rss": "RSS", "Pss": "PSS", "Private_Dirty": "private dirty"}
    found = {}
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines():
        name, _, value = line.partition(":")
        if name in names:
            found[names[name]] = float(value.split()[0]) / 1024.0
    return found

"""What a node's process costs, read from /proc."""

from __future__ import annotations

import os
import xmlrpc.client
from pathlib import Path


def node_pid(node: str, asker: str) -> int:
    """Return the process of a running node; `asker` is the name of who asks."""
    import rosgraph

    uri = rosgraph.Master(asker).lookupNode(node)
    return int(xmlrpc.client.ServerProxy(uri).getPid(asker)[2])


def cpu_seconds(pid: int) -> float:
    """Return the processor time (s) a process has used."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_bytes(pid: int) -> int:
    """Return the memory a process holds."""
    return int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")

"""Work for a driver: good, bad, and endless. Imports nothing at first, for each process imports it anew."""

import importlib
import os
import signal
import struct
import threading


def act(task):
    """Do what a task says."""
    if task == "throw":
        raise ValueError("a plugin's mistake")
    if task == "die":
        os.kill(os.getpid(), signal.SIGKILL)
    if task == "compute":
        while True:
            pass
    if task == "wait":
        threading.Event().wait(600.0)
    if task == "send half":
        for output in outputs():
            os.write(output, struct.pack("<Q", 100) + b"half")
        threading.Event().wait(600.0)
    if task == "close":
        for output in outputs():
            os.close(output)
        threading.Event().wait(600.0)
    if task == "leave a child":
        if os.fork():
            os._exit(7)
        signal.alarm(60)
        threading.Event().wait(600.0)
    if task == "print":
        print("a plugin that prints")
        return "printed"
    if task == "threads":
        return os.environ["OPENBLAS_NUM_THREADS"]
    if task == "package":
        import mbf_relay

        return mbf_relay.__file__
    return os.getpid() if task == "who" else task * 2


def pace_of(module):
    """Return a number that a module holds."""
    return importlib.import_module(module).PACE


def outputs():
    """Return the files that answers may go to: pipes that are written to, but for those everybody has."""
    found = []
    for name in os.listdir("/proc/self/fd"):
        path = f"/proc/self/fd/{name}"
        if int(name) > 2 and os.path.exists(path) and os.readlink(path).startswith("pipe:"):
            if os.lstat(path).st_mode & 0o200:
                found.append(int(name))
    return found

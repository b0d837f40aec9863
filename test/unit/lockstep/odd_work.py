"""Work for a driver: good, bad, and endless. Imports nothing at first, for each process imports it anew."""

import os
import signal
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
    if task == "print":
        print("a plugin that prints")
        return "printed"
    if task == "threads":
        return os.environ["OPENBLAS_NUM_THREADS"]
    if task == "package":
        import mbf_relay

        return mbf_relay.__file__
    return os.getpid() if task == "who" else task * 2

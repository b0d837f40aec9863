"""Helpers of the command line programs."""

from __future__ import annotations

import argparse
import math
import signal
import sys

from mbf_relay.importing import import_or_exit


def run(place: str) -> None:
    """Run a command that needs no cleanup when interrupted, and exit with the status it returns.

    Args:
        place: "package.module.function"; imported after the signal handlers are set.
    """
    end_in_silence()
    module, _, function = place.rpartition(".")
    sys.exit(getattr(import_or_exit(module), function)())


def end_in_silence() -> None:
    """Let SIGINT (Ctrl-C) and SIGPIPE (`| head`) end this process at once, instead of with a Python traceback.

    For commands that need no cleanup. Call it before slow imports.
    """
    for number in (signal.SIGINT, signal.SIGPIPE):
        signal.signal(number, signal.SIG_DFL)


def positive(text: str) -> int:
    """Parse an option that is an integer above 0; ArgumentTypeError otherwise."""
    try:
        value = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no whole number") from None
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is below 1")
    return value


def random_seed(text: str) -> int:
    """Parse an option that seeds random numbers, an integer from 0 to 2^32 - 1; ArgumentTypeError otherwise."""
    value = int(text) if text.strip().isdecimal() else -1
    if not 0 <= value < 1 << 32:
        raise argparse.ArgumentTypeError(f"'{text}' is no seed; it must be a whole number from 0 to {(1 << 32) - 1}")
    return value


def finite(text: str) -> float:
    """Parse an option that is a finite number; ArgumentTypeError otherwise."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is no finite number")
    return value

"""What commands have in common."""

from __future__ import annotations

import argparse
import math
import signal
import sys

from mbf_relay.importing import import_or_exit


def run(place: str) -> None:
    """Run a command that does one thing and leaves it whole or undone, and exit with the status it returns.

    Args:
        place: The function, with its module: imported once signals end this process.
    """
    end_in_silence()
    module, _, function = place.rpartition(".")
    sys.exit(getattr(import_or_exit(module), function)())


def end_in_silence() -> None:
    """Have Ctrl-C, and a reader of the output that has gone (`| head`), end this process as they end any other tool.

    For commands that nothing has to be put in order after; call it before anything else is imported. Python would show
    a traceback of whatever it was at.
    """
    for number in (signal.SIGINT, signal.SIGPIPE):
        signal.signal(number, signal.SIG_DFL)


def positive(text: str) -> int:
    """Return what an option says, a whole number above zero."""
    try:
        value = int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no whole number") from None
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is below 1")
    return value


def finite(text: str) -> float:
    """Return what an option says, a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is no finite number")
    return value

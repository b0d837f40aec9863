"""What commands that do one thing and leave it whole or undone have in common."""

from __future__ import annotations

import signal


def end_in_silence() -> None:
    """Have Ctrl-C, and a reader of the output that has gone (`| head`), end this process as they end any other tool.

    For commands that nothing has to be put in order after; call it before anything else is imported. Python would show
    a traceback of whatever it was at.
    """
    for number in (signal.SIGINT, signal.SIGPIPE):
        signal.signal(number, signal.SIG_DFL)

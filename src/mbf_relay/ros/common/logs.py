"""A node's log lines: they wait for nobody, and go where they still can where the disk is full or not to be written."""

from __future__ import annotations

import logging
import sys
from typing import Callable

TOPICS_IN_LOGS_DISABLED = "/rosout_disable_topics_generation"
"""rospy's parameter: whether log messages leave out the topics of the node."""
CONTINUED = "\n  | "
"""Between the lines of one message."""


def plain(text: str) -> str:
    """Return a text in which nothing can pass for a line of its own, nor steer a terminal.

    Names of frames, goals and plugins are anybody's. What cannot be printed is written as Python writes it; what
    comes after a line feed, as in a traceback, stays a line, but one that nothing else begins like.
    """
    if text.isprintable():
        return text
    return CONTINUED.join(
        "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in line) for line in text.split("\n")
    )


class PlainRecord(logging.LogRecord):
    """A line of the log that tells the words of strangers in plain text, wherever it goes."""

    def getMessage(self) -> str:
        """Return the line."""
        return plain(super().getMessage())


def complain_once() -> None:
    """Have a log that cannot be written told in one sentence, not in a traceback for each line; before init_node."""
    told = False

    def tell(_handler: logging.Handler, _record: logging.LogRecord) -> None:
        nonlocal told
        if not told:
            told = True
            _print(f"the log cannot be written ({sys.exc_info()[1]}); lines go to the terminal and to /rosout alone")

    logging.Handler.handleError = tell  # type: ignore[method-assign, assignment]


def _print(text: str) -> None:
    try:
        print(f"[WARN] {text}", file=sys.stderr, flush=True)
    except OSError:
        pass  # where it goes is full, too


def log_without_master() -> None:
    """Have log lines ask the master nothing: a robot would stand, and goals wait, as long as it hangs; after init_node.

    For each line rospy looks for a parameter that hardly anybody sets, and keeps only what is set. It is read once,
    here.
    """
    import rospy
    from rospy.impl import paramserver

    disabled = bool(rospy.get_param(TOPICS_IN_LOGS_DISABLED, False))
    paramserver.get_param_server_cache().set(TOPICS_IN_LOGS_DISABLED, disabled)


def log_to_terminal() -> None:
    """Have log lines on the terminal, wherever that leads; after init_node.

    Where rospy found no folder to write in it has set up nothing. Where the terminal is closed, or a file on a full
    disk, its handler would raise an error in the middle of what the node does.
    """
    from rosgraph.roslogging import RosStreamHandler

    logger = logging.getLogger("rosout")
    terminals = [handler for handler in logger.handlers if isinstance(handler, RosStreamHandler)]
    if not terminals and not logging.getLogger().handlers:
        terminals = [RosStreamHandler()]
        logger.addHandler(terminals[0])
        logger.setLevel(logging.INFO)
    for terminal in terminals:
        terminal.emit = _forgiving(terminal)


def _forgiving(handler: logging.Handler) -> Callable[[logging.LogRecord], None]:
    """Return a handler's `emit` that complains where it cannot write."""
    emit = handler.emit

    def emit_or_complain(record: logging.LogRecord) -> None:
        try:
            emit(record)
        except (OSError, ValueError):
            handler.handleError(record)

    return emit_or_complain

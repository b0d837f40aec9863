"""A node's log lines: they wait for nobody, and go where they still can where the disk is full or not to be written."""

from __future__ import annotations

import atexit
import collections
import logging
import sys
import threading
from typing import Deque

TOPICS_IN_LOGS_DISABLED = "/rosout_disable_topics_generation"
"""rospy's parameter: whether log messages leave out the topics of the node."""
CONTINUED = "\n  | "
"""Between the lines of one message."""
MOST_WAITING = 1000
"""Lines that may wait for a terminal that takes none."""
LAST_WORDS = 0.5
"""Wall seconds that a terminal gets for what waits when the node ends."""


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

    _text: str

    def getMessage(self) -> str:
        """Return the line, as it was when it was first asked for: what it tells of may change before it is written."""
        if "_text" not in self.__dict__:
            self._text = plain(super().getMessage())
        return self._text


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
    """Have log lines on the terminal, wherever that leads, and nobody wait for it; after init_node.

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
        scribe = Scribe(terminal)
        terminal.emit = scribe.take
        atexit.register(scribe.finish)


class Scribe:
    """Writes a handler's lines in a thread of its own, and complains where it cannot.

    A terminal may take nothing for as long as it likes: Ctrl-S, a pager at the other end of a pipe, an ssh whose cable
    was pulled. Whoever logs a line would stop right there, with a lock that whoever logs the next one waits for, be it
    the watchdog, and the robot would drive on by the last velocity.

    Args:
        handler: Whose `emit` writes.
    """

    def __init__(self, handler: logging.Handler) -> None:
        self._handler, self._emit = handler, handler.emit
        self._condition = threading.Condition()  # guards the four below; never held while a line is written
        self._waiting: Deque[logging.LogRecord] = collections.deque()
        self._lost, self._began, self._writing = 0, False, False

    def take(self, record: logging.LogRecord) -> None:
        """Have a line written, soon; of more than MOST_WAITING the oldest are left out."""
        record.getMessage()
        with self._condition:
            if len(self._waiting) == MOST_WAITING:
                self._waiting.popleft()
                self._lost += 1
            self._waiting.append(record)
            self._condition.notify_all()
            if not self._began:
                self._began = True
                threading.Thread(target=self._loop, name="terminal", daemon=True).start()

    def finish(self) -> None:
        """Wait for what waits to be written, but not for ever."""
        with self._condition:
            self._condition.wait_for(lambda: not (self._waiting or self._writing), LAST_WORDS)

    def _loop(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: bool(self._waiting))
                record, lost, self._lost, self._writing = self._waiting.popleft(), self._lost, 0, True
            if lost:
                self._write(logging.makeLogRecord({
                    "levelname": "WARNING", "levelno": logging.WARNING,
                    "msg": f"{lost} lines are left out here; the terminal took none"}))
            self._write(record)
            with self._condition:
                self._writing = False
                self._condition.notify_all()

    def _write(self, record: logging.LogRecord) -> None:
        try:
            self._emit(record)
        except (OSError, ValueError):
            self._handler.handleError(record)

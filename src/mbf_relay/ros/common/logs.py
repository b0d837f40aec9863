"""Logging of a node: writing a line never blocks, and a full or read-only disk costs the log file alone."""

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
"""Separator of the lines of one message, so that none of them looks like a message of its own."""
MOST_WAITING = 1000
"""Lines that are kept while a terminal or disk blocks."""
LAST_WORDS = 0.5
"""Wall seconds that each handler gets to write its remaining lines when the node ends."""


def plain(text: str) -> str:
    """Return a text without control characters, in which no line can be mistaken for a log line of its own.

    Names of frames, goals and plugins come from outside. Unprintable characters are escaped as Python does; lines after
    the first, as of a traceback, begin with a mark.
    """
    if text.isprintable():
        return text
    return CONTINUED.join(
        "".join(sign if sign.isprintable() else repr(sign)[1:-1] for sign in line) for line in text.split("\n")
    )


class PlainRecord(logging.LogRecord):
    """A log record whose text has no control characters; see `plain`."""

    _text: str

    def getMessage(self) -> str:
        """Return the text as formatted at the first call: its arguments may change before it is written."""
        if "_text" not in self.__dict__:
            self._text = plain(super().getMessage())
        return self._text


def report_unwritable_log_once() -> None:
    """Report a log that cannot be written by one line, not by a traceback for each record; before init_node."""
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
        pass  # stderr cannot be written either


def log_without_master() -> None:
    """Stop log lines from asking the master, which may hang and would block whoever logs; after init_node.

    For each line rospy asks for TOPICS_IN_LOGS_DISABLED, and caches the answer only where the parameter is set. It is
    read once, here.
    """
    import rospy
    from rospy.impl import paramserver

    disabled = bool(rospy.get_param(TOPICS_IN_LOGS_DISABLED, False))
    paramserver.get_param_server_cache().set(TOPICS_IN_LOGS_DISABLED, disabled)


def log_without_waiting() -> None:
    """Write log lines to file and terminal in threads of their own; after init_node.

    Where rospy found no writable folder for its log it has set up no terminal handler either; one is added. Where the
    terminal is closed, or the disk is full, rospy's handler would raise its error in whichever thread logs.
    """
    from rosgraph.roslogging import RosStreamHandler

    rosout, root = logging.getLogger("rosout"), logging.getLogger()
    if not root.handlers and not any(isinstance(handler, RosStreamHandler) for handler in rosout.handlers):
        rosout.addHandler(RosStreamHandler())
        rosout.setLevel(logging.INFO)
    for logger, kind in (rosout, RosStreamHandler), (root, logging.FileHandler):
        for handler in [handler for handler in logger.handlers if isinstance(handler, kind)]:
            logger.removeHandler(handler)
            logger.addHandler(Scribe(handler))


class Scribe(logging.Handler):
    """A logging handler that passes records to another one in a thread of its own.

    Writing to a terminal may block for any time (Ctrl-S, a pager at the end of a pipe, an ssh connection that is cut),
    and so may a file on a network disk. The thread that logs would block there with logging's lock held, then every
    other that logs, the watchdog among them, and the robot would go on at its last velocity.

    Args:
        handler: The handler that writes.
    """

    def __init__(self, handler: logging.Handler) -> None:
        super().__init__(handler.level)
        self._handler = handler
        self._condition = threading.Condition()  # guards the four below; never held while a line is written
        self._waiting: Deque[logging.LogRecord] = collections.deque()
        self._lost, self._began, self._writing = 0, False, False
        atexit.register(self.finish)

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a record; where MOST_WAITING wait already, the oldest is dropped."""
        record.getMessage()
        with self._condition:
            if len(self._waiting) == MOST_WAITING:
                self._waiting.popleft()
                self._lost += 1
            self._waiting.append(record)
            self._condition.notify_all()
            if not self._began:
                self._began = True
                threading.Thread(target=self._loop, name="log", daemon=True).start()

    def finish(self) -> None:
        """Wait until all records are written, for LAST_WORDS at most."""
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
                    "msg": f"{lost} lines are left out here; none were taken"}))
            self._write(record)
            with self._condition:
                self._writing = False
                self._condition.notify_all()

    def _write(self, record: logging.LogRecord) -> None:
        try:
            self._handler.handle(record)
        except (OSError, ValueError):
            self._handler.handleError(record)

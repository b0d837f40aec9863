"""How every node starts and ends: one line for what is wrong, no traceback for what a user can mend."""

from __future__ import annotations

import gc
import sys
import time
from typing import Callable

import rospy
import rospy.core

from mbf_relay.outcomes import StaleDataError, TransformError

FLUSH_TIME = 0.2
"""Wall seconds that rospy's sending threads need for last words."""

USER_ERRORS = (ValueError, OSError, TransformError, StaleDataError)
"""What a wrong parameter, a missing file or an absent node raise; their text is the whole message."""


def run_node(name: str, main: Callable[[], None]) -> None:
    """Register a node, run `main` until it returns, and exit.

    The exit status is 0 after `main` returned or ROS was shut down, be it by Ctrl-C while the node waits for a master,
    and 1 after an error a user can mend, which is logged as one line. A programming error keeps its traceback. `--help`
    prints what the module of `main` says of itself (its USAGE where it has one, else its docstring) and needs no ROS
    master.
    """
    if {"-h", "--help"} & set(rospy.myargv(sys.argv)[1:]):
        module = sys.modules[main.__module__]
        print(str(getattr(module, "USAGE", module.__doc__)).strip())
        sys.exit(0)
    try:
        rospy.init_node(name)
        main()
    except rospy.ROSInterruptException:
        sys.exit(0)
    except rospy.ROSInitException:
        if not rospy.is_shutdown():
            raise
        sys.exit(0)
    except USER_ERRORS as error:
        rospy.logfatal("%s", one_line(error))
        rospy.signal_shutdown(one_line(error))
        sys.exit(1)


def on_shutdown(last_words: Callable[[], None]) -> None:
    """Have `last_words` called when the node ends, while it can still publish, and what it publishes sent."""
    def speak() -> None:
        last_words()
        time.sleep(FLUSH_TIME)

    rospy.on_shutdown(speak)


def spare_what_stays() -> None:
    """Keep what a node has made by now, its libraries above all, out of garbage collection; call when it is ready.

    A collection of all that stops every thread for a tenth of a second, in the middle of a drive.
    """
    gc.collect()
    gc.freeze()


def one_line(error: BaseException) -> str:
    """Return an exception's text on one line."""
    return " ".join(str(error).split()) or type(error).__name__

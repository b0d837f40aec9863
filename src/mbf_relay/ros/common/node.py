"""Start and end of every node: errors that a user can fix are one line, programming errors a traceback."""

from __future__ import annotations

import errno
import gc
import importlib
import math
import os
import resource
import sys
import time
from typing import Any, Callable, Optional, Sequence

from mbf_relay import memory
from mbf_relay.importing import import_or_exit
from mbf_relay.ros.common.ending import NodeEnding

INTERRUPTED = 130
"""Exit status of a program that was interrupted, as in shells (128 + SIGINT)."""
MASTER_PERIOD = 0.1
"""Wall seconds between two attempts to reach a master that is not there yet."""
FLUSH_TIME = 0.2
"""Wall seconds that rospy's sending threads get for what is published at shutdown."""
ALGEBRA_THREADS = "OPENBLAS_NUM_THREADS"
"""Environment variable: OpenBLAS' number of threads. They spin after each call, and took two thirds of amcl's time."""
READ_ON = "\n\nIn the package: launch/README.md has its topics and services, config/README.md its parameters."
"""The end of what --help of a node without arguments prints."""


def run_node(name: str, place: str, **arguments: Any) -> None:
    """Register a node, run its main function until it returns, and end the process.

    The exit status is 0 where the function returned or ROS was shut down, also by a signal at any moment from here on.
    It is 1 after an error that a user can fix, which is logged as one line, after a programming error, which prints its
    traceback, and where the master was restarted, so that respawn="true" starts the node again.

    `--help` prints the module's USAGE, else the docstring of the executable or module. A module that takes command line
    arguments has a function `check_arguments`, which raises ValueError or SystemExit. Neither needs a ROS master.

    Args:
        name: Name of the node.
        place: Full name of the function, e.g. "mbf_relay.ros.amcl.node.main"; its module is imported here, when
            signals are handled already.
        arguments: Passed to the function.
    """
    ending = NodeEnding()
    os.environ.setdefault(ALGEBRA_THREADS, "1")  # before NumPy is imported
    import_rospy()
    import rospy  # imported after NodeEnding(), hence not interrupted by signals

    module_name, _, function = place.rpartition(".")
    importlib.import_module("mbf_relay.ros.common.reconfigure")  # silences a complaint of dynamic_reconfigure's import
    module = import_or_exit(module_name)
    line = rospy.myargv(sys.argv)[1:]
    if {"-h", "--help"} & set(line):
        about = str(sys.modules["__main__"].__doc__ or module.__doc__).strip()
        print(str(getattr(module, "USAGE", about + READ_ON)).strip())
        ending.leave(0)
    status = _check_command_line(name, line, getattr(module, "check_arguments", None))
    if status:
        ending.leave(status)
    ending.use(rospy.signal_shutdown)
    ending.leave(_run_main(name, lambda: getattr(module, function)(**arguments), ending))


def import_rospy() -> None:
    """Set up logging and import rospy with `rospy_patches`; before any other import of rospy."""
    import logging

    from mbf_relay.ros.common import logs
    from mbf_relay.ros.common.rospy_patches.lazy_modules import import_lazily

    logging.setLogRecordFactory(logs.PlainRecord)
    logs.report_unwritable_log_once()
    import_lazily()
    from mbf_relay.ros.common.rospy_patches import accepting, connecting, receiving, sending, starting

    for module in (accepting, connecting, starting, receiving, sending):
        module.apply_patches()


def _check_command_line(name: str, line: Sequence[str], check: Optional[Callable[[Sequence[str]], Any]]) -> int:
    """Check a node's command line arguments; return 0 where they are valid, else print why and return an exit status.

    Arguments of a node that takes none are ignored, as by upstream's nodes, but with a warning.
    """
    if check is None:
        if line:
            print(f"{name}: '{line[0]}' is ignored: it takes no arguments; parameters are given as _name:=value, names "
                  "as old:=new", file=sys.stderr)
        return 0
    try:
        check(line)
    except SystemExit as end:
        return int(end.code or 0)
    except ValueError as error:
        print(f"{name}: {one_line(error)}", file=sys.stderr)
        return 1
    return 0


def run_program(place: str) -> None:
    """Run a command line program that uses ROS; its function reads the arguments, calls init_node and ends by sys.exit.

    A signal shuts it down as it does a node, at any moment from here on, but the exit status is INTERRUPTED then, so
    that a shell does not go on after `&&`.

    Args:
        place: Full name of the function, as for `run_node`.
    """
    ending = NodeEnding(INTERRUPTED)
    import_rospy()
    import traceback

    import rospy

    module_name, _, function = place.rpartition(".")
    module = import_or_exit(module_name)
    ending.use(rospy.signal_shutdown)
    status: Any = 0
    try:
        getattr(module, function)()
    except SystemExit as end:
        status = end.code or 0
    except Exception:  # those that rospy raises because of a shutdown are not reported
        if not rospy.core.is_shutdown_requested():  # is_shutdown turns true only when topics are closed
            traceback.print_exc()
        status = 1
    if ending.begun:
        status = INTERRUPTED
    elif rospy.core.is_initialized():
        rospy.signal_shutdown("done")
    ending.leave(status)


def _run_main(name: str, main: Callable[[], None], ending: NodeEnding) -> int:
    """Start a node, run `main` and shut ROS down; return the exit status."""
    import traceback

    import rospy

    from mbf_relay.kernels import reason_in_process
    from mbf_relay.outcomes import StaleDataError, TransformError
    from mbf_relay.ros.common import logs
    from mbf_relay.ros.common.master_watch import MasterWatch
    from mbf_relay.ros.common.own_address import warn_where_unreachable

    status = 0

    def start_again(reason: str) -> None:
        nonlocal status
        status = 1
        rospy.logfatal("%s", reason)
        rospy.signal_shutdown(reason)
        ending.leave(1)

    try:
        _wait_for_master(name)
        rospy.init_node(name, disable_signals=True)
        logs.log_without_waiting()
        logs.log_without_master()
        MasterWatch(start_again)
        warn_where_unreachable()
        reason = reason_in_process()
        if reason:
            rospy.logwarn("numba compiles kernels in this process, which takes 100 MiB more memory: %s", reason)
        main()
    except rospy.ROSInterruptException:
        pass
    except rospy.ROSInitException as error:  # the master ended while this node registered
        if not rospy.core.is_shutdown_requested():
            print(f"the node {name} could not be started: {one_line(error)}", file=sys.stderr)
            return 1
    # a wrong parameter, a missing file, an absent node
    except (ValueError, OSError, TransformError, StaleDataError) as error:
        if not rospy.core.is_shutdown_requested():
            rospy.logfatal("%s", one_line(error))
            rospy.signal_shutdown(one_line(error))
            return 1
    except Exception as error:
        if not rospy.core.is_shutdown_requested():
            traceback.print_exc()
            rospy.signal_shutdown(one_line(error))
            return 1
    rospy.signal_shutdown("done")
    return status


def _wait_for_master(name: str) -> None:
    """Wait for the master; rospy waits, too, but a node with parameters on its command line fails without a master.

    A master that does not have the run_id of the roslaunch that started this node was restarted after that. Surviving
    nodes then restore the parameters of this launch (see MasterWatch), which is waited for, GIVEN_BACK_WITHIN at most.
    """
    import xmlrpc.client  # nosec B411: what the ROS master speaks

    import rosgraph
    import rospy

    from mbf_relay.ros.common.master_watch import GIVEN_BACK_WITHIN, RUN_ID

    own = rosgraph.names.make_caller_id(rospy.names.load_mappings(sys.argv).get("__name", name))
    master, said, given_up_at = rosgraph.Master(own), False, math.inf
    log = _launch_log()
    while not rospy.core.is_shutdown_requested():
        try:
            master.getPid()
            if not log or master.hasParam(own) or time.monotonic() > given_up_at:
                return
            if master.hasParam(f"/{RUN_ID}") and str(master.getParam(f"/{RUN_ID}")) in log:
                return
            given_up_at = min(given_up_at, time.monotonic() + GIVEN_BACK_WITHIN)
        except OSError as error:
            if not said:
                where = rosgraph.get_master_uri()
                print(f"no ROS master at {where} ({one_line(error)}); waiting for it", file=sys.stderr)
            said = True
        except (xmlrpc.client.Error, rosgraph.MasterException):
            return  # not a ROS master, or one with an error: rospy reports it
        time.sleep(MASTER_PERIOD)


def _launch_log() -> str:
    """Return the argument `__log:=...` that roslaunch gives its nodes, whose path has the run_id; empty without it.

    Read from /proc, as a forked node has its parent's command line there and not in sys.argv.
    """
    with open("/proc/self/cmdline", encoding="utf-8", errors="replace") as stream:
        return next((word for word in stream.read().split("\0") if word.startswith("__log:=")), "")


def on_shutdown(last_words: Callable[[], None]) -> None:
    """Call `last_words` at shutdown, while the node can still publish, and wait until what it published is sent."""
    import rospy

    def speak() -> None:
        last_words()
        time.sleep(FLUSH_TIME)

    rospy.on_shutdown(speak)


def spare_what_stays() -> None:
    """Exclude all objects made so far from garbage collection (gc.freeze); call when the node is ready.

    A full collection stops every thread for a tenth of a second. Memory that only the start needed is returned to the
    system: a MiB or more.
    """
    gc.collect()
    gc.freeze()
    memory.give_back_free()


def one_line(error: BaseException) -> str:
    """Return an exception's text on one line, with a hint where the process has too many open files."""
    text = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, OSError) and error.errno == errno.EMFILE:
        most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        text += f"; it may have {most} open, sockets included: raise that by ulimit -n"
    return text

"""How every node starts and ends: one line for what is wrong, no traceback for what a user can mend."""

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
"""Exit status of a program that was interrupted, as shells have it: it did not do what it was asked to."""
MASTER_PERIOD = 0.1
"""Wall seconds between two looks for a master that is not there yet."""
FLUSH_TIME = 0.2
"""Wall seconds that rospy's sending threads need for last words."""
ALGEBRA_THREADS = "OPENBLAS_NUM_THREADS"
"""Environment variable: OpenBLAS keeps as many threads, which spin after each call, and took two thirds of amcl's time.
"""


READ_ON = "\n\nIn the package: launch/README.md has its topics and services, config/README.md its parameters."
"""What --help of a node without arguments ends with: they are too many for it."""


def run_node(name: str, place: str, **arguments: Any) -> None:
    """Register a node, run its main function until it returns, and end the process.

    The exit status is 0 after the function returned or ROS was shut down, be it by a signal at any moment from here on,
    and 1 after an error a user can mend, which is logged as one line, and where there is a new master, so that whoever
    started the node starts it again. A programming error keeps its traceback. `--help` prints what the module says of
    itself (its USAGE where it has one, else the executable's docstring or its own) and needs no ROS master, nor does
    what the module's `check_arguments`, where it has that, says of the command line; any other node takes none.

    Args:
        name: Of the node.
        place: The function, with its module: "mbf_relay.ros.amcl.node.main". It is imported here, so that a signal
            finds the node ready to end.
        arguments: For the function.
    """
    ending = NodeEnding()
    os.environ.setdefault(ALGEBRA_THREADS, "1")  # before NumPy is imported
    _start_soon()
    import rospy  # what is imported here and below, after NodeEnding(), no signal can interrupt

    module_name, _, function = place.rpartition(".")
    importlib.import_module("mbf_relay.ros.common.reconfigure")  # quietens dynamic_reconfigure
    module = import_or_exit(module_name)
    line = rospy.myargv(sys.argv)[1:]
    if {"-h", "--help"} & set(line):
        about = str(sys.modules["__main__"].__doc__ or module.__doc__).strip()
        print(str(getattr(module, "USAGE", about + READ_ON)).strip())
        ending.leave(0)
    status = _misread(name, line, getattr(module, "check_arguments", None))
    if status:
        ending.leave(status)
    ending.use(rospy.signal_shutdown)
    ending.leave(_live(name, lambda: getattr(module, function)(**arguments), ending))


def _misread(name: str, line: Sequence[str], check: Optional[Callable[[Sequence[str]], Any]]) -> int:
    """Return the exit status of a command line that a node cannot take, having said why; 0 of one that it can.

    What upstream's nodes pass over in silence is passed over here as well, and said.
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
    """Run a program that does one thing and tells by its exit status whether it did.

    It reads its arguments, starts a node of its own and ends by sys.exit. A signal ends it at any moment from here on
    as it ends a node, with INTERRUPTED, for whatever a shell's && has after it must not be done then.

    Args:
        place: The function, with its module, as for `run_node`.
    """
    ending = NodeEnding(INTERRUPTED)
    _start_soon()
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
    except Exception:  # rospy's own at a shutdown that has begun are none
        if not rospy.core.is_shutdown_requested():  # is_shutdown turns true only when topics are closed
            traceback.print_exc()
        status = 1
    if ending.begun:
        status = INTERRUPTED
    elif rospy.core.is_initialized():
        rospy.signal_shutdown("done")
    ending.leave(status)


def _start_soon() -> None:
    """Import rospy, without what nobody uses, and have it start a node sooner, receive with less and log plainly."""
    import logging

    from mbf_relay.ros.common import logs
    from mbf_relay.ros.common.rospy_patches.lazy_modules import spare_what_nobody_uses

    logging.setLogRecordFactory(logs.PlainRecord)
    logs.complain_once()
    spare_what_nobody_uses()
    from mbf_relay.ros.common.rospy_patches.accepting import hear_out_each_by_itself
    from mbf_relay.ros.common.rospy_patches.connecting import connect_surely
    from mbf_relay.ros.common.rospy_patches.receiving import receive_with_less
    from mbf_relay.ros.common.rospy_patches.sending import send_with_less
    from mbf_relay.ros.common.rospy_patches.starting import start_soon

    hear_out_each_by_itself()
    connect_surely()
    start_soon()
    receive_with_less()
    send_with_less()


def _live(name: str, main: Callable[[], None], ending: NodeEnding) -> int:
    """Return the exit status of a node's life."""
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
    except rospy.ROSInitException as error:  # the master left while this node came
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
    """Return when there is a master: rospy waits for one, too, but ends a node that has parameters as arguments.

    One that does not know the roslaunch this node is of has come after another's end. Nodes that outlived that one give
    it the parameters that this node was launched with (see MasterWatch), and these are waited for.
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
            return  # what answers there is for rospy to judge
        time.sleep(MASTER_PERIOD)


def _launch_log() -> str:
    """Return the log that roslaunch names to its nodes, which has the id of its run in it; empty without roslaunch.

    A node that was forked has the command line of its parent, which roslaunch started.
    """
    with open("/proc/self/cmdline", encoding="utf-8", errors="replace") as stream:
        return next((word for word in stream.read().split("\0") if word.startswith("__log:=")), "")


def on_shutdown(last_words: Callable[[], None]) -> None:
    """Have `last_words` called when the node ends, while it can still publish, and what it publishes sent."""
    import rospy

    def speak() -> None:
        last_words()
        time.sleep(FLUSH_TIME)

    rospy.on_shutdown(speak)


def spare_what_stays() -> None:
    """Keep what a node has made by now, its libraries above all, out of garbage collection; call when it is ready.

    A collection of all that stops every thread for a tenth of a second, in the middle of a drive. What was needed to
    start alone goes back to the system: a MiB or more.
    """
    gc.collect()
    gc.freeze()
    memory.give_back_free()


def one_line(error: BaseException) -> str:
    """Return an exception's text on one line, and what to do where the node may open no more files."""
    text = " ".join(str(error).split()) or type(error).__name__
    if isinstance(error, OSError) and error.errno == errno.EMFILE:
        most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        text += f"; it may have {most} open, sockets included: raise that by ulimit -n"
    return text

"""The end of a node is told by what it did, not by what rospy closes under it."""

import errno
import types

import pytest
import rospy

from mbf_relay.ros.common import logs, master_watch, node


@pytest.fixture
def closing(monkeypatch):
    """Have rospy be where it has closed a node's topics and does not call that a shutdown yet."""
    monkeypatch.setattr(rospy, "init_node", lambda *_args, **_keywords: None)
    monkeypatch.setattr(node, "_wait_for_master", lambda _name: None)
    monkeypatch.setattr(rospy.core, "_in_shutdown", False)
    monkeypatch.setattr(rospy.core, "_shutdown_flag", False)
    for name in ("report_unwritable_log_once", "log_without_waiting", "log_without_master"):
        monkeypatch.setattr(logs, name, lambda: None)
    monkeypatch.setattr(master_watch, "MasterWatch", lambda _start_again: None)

    def publish():
        monkeypatch.setattr(rospy.core, "_in_shutdown", True)
        raise rospy.ROSException("topic was closed during publish()")

    return publish


def test_a_node_stopped_while_it_publishes_ends_without_a_traceback(closing, capsys):
    assert node._run_main("amcl", closing, None) == 0
    assert "Traceback" not in capsys.readouterr().err


def test_a_node_whose_master_leaves_while_it_starts_says_so_in_one_line(closing, capsys, monkeypatch):
    def init_node(*_arguments, **_keywords):
        raise rospy.ROSInitException("Failed to initialize time.\nPlease check logs for additional details")

    monkeypatch.setattr(rospy, "init_node", init_node)
    assert node._run_main("amcl", closing, None) == 1
    (said,) = capsys.readouterr().err.splitlines()
    assert "amcl could not be started: Failed to initialize time. Please check" in said


def test_a_node_that_may_open_too_few_files_says_how_that_is_changed():
    text = node.one_line(OSError(errno.EMFILE, "Too many open files"))
    assert "Too many open files; it may have " in text and text.endswith("raise that by ulimit -n")
    assert node.one_line(OSError(errno.ENOENT, "No such file")) == "[Errno 2] No such file"


def test_a_client_stopped_while_it_publishes_ends_without_a_traceback(closing, capsys, monkeypatch):
    class Ending:
        begun = True

        def __init__(self, _status):
            pass

        def use(self, _shut_down):
            pass

        def leave(self, status):
            ended.append(status)

    ended = []
    monkeypatch.setattr(node, "NodeEnding", Ending)
    module = types.SimpleNamespace(main=closing)
    monkeypatch.setattr(node.importlib, "import_module", lambda _name: module)
    node.run_program("module.main")
    assert ended == [node.INTERRUPTED]
    assert "Traceback" not in capsys.readouterr().err

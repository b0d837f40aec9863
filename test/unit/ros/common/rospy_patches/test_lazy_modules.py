"""What nobody uses takes no memory, and is there for whoever does."""

import subprocess
import sys

import pytest

PREPARE = (
    "import sys; from mbf_relay.ros.common.rospy_patches.lazy_modules import *; import_lazily(); "
    "import numpy as np; "
)
IS_SPARED = "print(type(sys.modules['numpy.ma']).__name__); "


def output(code):
    return subprocess.check_output([sys.executable, "-c", PREPARE + code], text=True, timeout=60.0).split()


@pytest.mark.parametrize("use", [
    "print(np.ma.masked_invalid([1.0, np.nan]).sum())",
    "from numpy.ma import masked_invalid; print(masked_invalid([1.0, np.nan]).sum())",
    "import numpy.ma as ma; print(ma.masked_invalid([1.0, np.nan]).sum())",
    "import numpy.ma; print(numpy.ma.masked_invalid([1.0, np.nan]).sum())",
])
def test_a_plugin_of_a_users_own_has_what_it_imports(use):
    assert output(IS_SPARED + use) == ["LazyModule", "1.0"]


def test_two_threads_that_need_a_module_at_once_both_have_it_whole():
    """The update of a costmap failed where that of another had begun to look into numpy.ma."""
    looks = """
import threading
ready, missed = threading.Barrier(8), []
def look():
    ready.wait()
    try:
        np.ma.isMaskedArray(0)
    except AttributeError as error:
        missed.append(error)
sys.setswitchinterval(1e-6)
threads = [threading.Thread(target=look) for _ in range(8)]
[thread.start() for thread in threads], [thread.join() for thread in threads]
print(len(missed))
"""
    assert output(IS_SPARED + looks) == ["LazyModule", "0"]


def test_encryption_is_there_for_who_wants_it():
    assert output("import http.client, ssl; print(ssl.create_default_context().check_hostname)") == ["True"]


def test_it_is_asked_for_once():
    told = "print(sum(isinstance(finder, LazyFinder) for finder in sys.meta_path))"
    assert output("import_lazily(); " + told) == ["1"]


def test_a_module_that_is_not_there_is_missed_as_ever():
    assert output("print(LazyFinder(['no.such']).find_spec('no.such', []))") == ["None"]


def test_who_imports_it_once_more_or_looks_for_a_module_by_its_file_does_not_execute_it():
    looks = "import numpy.ma; importlib.import_module('numpy.ma'); import inspect; inspect.getmodule(sys._getframe()); "
    assert output("import importlib; " + looks + IS_SPARED) == ["LazyModule"]


def test_a_server_of_xmlrpc_tells_of_its_methods():
    told = """
import pydoc
from xmlrpc.server import SimpleXMLRPCDispatcher
server = SimpleXMLRPCDispatcher()
server.register_function(sum)
print(type(pydoc).__name__, server.system_methodHelp("sum").split()[0], pydoc.HTMLDoc.__name__)
"""
    assert output(told) == ["LazyModule", "Return", "HTMLDoc"]

"""A node holds no more after many goals, or once a crowd of clients has come and left, than before."""

import subprocess
import sys

import pytest

CROWD = """
import ctypes, threading
{start}
everyone_is_there, have_left = threading.Barrier(21), threading.Event()

def serve_a_client():
    message = [bytes(1000) for _ in range(200)]
    everyone_is_there.wait()
    have_left.wait()

threads = [threading.Thread(target=serve_a_client) for _ in range(20)]
[thread.start() for thread in threads]
everyone_is_there.wait()
have_left.set()
[thread.join() for thread in threads]
libc = ctypes.CDLL(None)
libc.open_memstream.restype = ctypes.c_void_p
text, size = ctypes.c_char_p(), ctypes.c_size_t()
stream = ctypes.c_void_p(libc.open_memstream(ctypes.byref(text), ctypes.byref(size)))
libc.malloc_info(0, stream)
libc.fclose(stream)
print(text.value.decode().count("<heap nr="))
"""

MAPS = """
import ctypes
{start}
libc = ctypes.CDLL(None)
libc.malloc.restype, libc.free.argtypes = ctypes.c_void_p, [ctypes.c_void_p]

class Use(ctypes.Structure):
    _fields_ = [(name, ctypes.c_int) for name in "arena ordblks smblks hblks hblkhd a b c d e".split()]

libc.mallinfo.restype = Use
libc.free(libc.malloc(8 << 20))
before = libc.mallinfo().hblks
libc.malloc(1 << 20)
print(libc.mallinfo().hblks - before)
"""
STARTS = pytest.mark.parametrize("start", [
    "from mbf_relay.memory import hold_little; hold_little()",
    "from mbf_relay.ros.common.ending import NodeEnding; NodeEnding()",
], ids=["asked for", "a node"])
ON_LINUX = pytest.mark.skipif(sys.platform != "linux", reason="of glibc")


def run(program):
    """Return what a Python program says, which must end well."""
    pytest.importorskip("ctypes")
    return subprocess.check_output([sys.executable, "-c", program], text=True, timeout=120.0)


@ON_LINUX
@STARTS
def test_maps_lie_apart_from_what_stays_also_after_one_was_given_back(start):
    """A server held 5 % more after a thousand goals than after two hundred: its maps lay among small pieces by then."""
    assert run(MAPS.format(start=start)).split() == ["1"]


@ON_LINUX
@STARTS
def test_threads_of_a_crowd_of_clients_fill_up_no_memory_of_their_own(start):
    """A server that twenty clients had sent goals to for half a minute held 17 MiB more from then on."""
    assert run(CROWD.format(start=start)).split() == ["1"]


def test_where_the_c_library_is_another_nothing_is_done(monkeypatch):
    import ctypes

    from mbf_relay import memory

    monkeypatch.setattr(ctypes, "CDLL", lambda _name: object())
    memory.hold_little()
    memory.keep_free()
    memory.give_back_free()

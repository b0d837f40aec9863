"""A node that a crowd of clients has come to and left holds no more than before they came."""

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


@pytest.mark.skipif(sys.platform != "linux", reason="of glibc's arenas")
@pytest.mark.parametrize("start", [
    "from mbf_relay.memory import share_arenas; share_arenas()",
    "from mbf_relay.ros.common.ending import NodeEnding; NodeEnding()",
], ids=["asked for", "a node"])
def test_threads_of_a_crowd_of_clients_fill_up_no_memory_of_their_own(start):
    """A server that twenty clients had sent goals to for half a minute held 17 MiB more from then on."""
    pytest.importorskip("ctypes")
    told = subprocess.check_output([sys.executable, "-c", CROWD.format(start=start)], text=True, timeout=120.0)
    assert told.split() == ["1"]


def test_where_the_c_library_is_another_nothing_is_done(monkeypatch):
    import ctypes

    from mbf_relay import memory

    monkeypatch.setattr(ctypes, "CDLL", lambda _name: object())
    memory.share_arenas()
    memory.keep_free()
    memory.give_back_free()

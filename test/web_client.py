"""A browser without a page: speaks to web_view as the page does, for tests and figures."""

import asyncio
import collections
import json
import socket
import threading
import zlib

import tornado.httpclient
import tornado.websocket
from ros_testing import wait_until
from view_batches import number_of, parts_of

EVERYTHING = (
    "robot",
    "state",
    "map",
    "global_costmap",
    "local_costmap",
    "scan",
    "particles",
    "global_plan",
    "local_plan",
    "footprint",
    "obstacles",
    "trajectories",
    "diagnostics",
    "log",
)


class Loop:
    """One event loop in a thread, which all clients of a process share."""

    _loop = None

    @classmethod
    def run(cls, coroutine, timeout=30.0):
        """Return what a coroutine returns."""
        if cls._loop is None:
            cls._loop = asyncio.new_event_loop()
            threading.Thread(target=cls._loop.run_forever, daemon=True).start()
        return asyncio.run_coroutine_threadsafe(coroutine, cls._loop).result(timeout)


class WebClient:
    """A connection to web_view.

    Attributes:
        said: Every text message, as a dictionary.
        newest: The newest header and payload of each layer.
        count, size: Parts and bytes of each layer.
        closed: The code and the reason, once the connection has ended.
    """

    def __init__(self, port, token="", layers=EVERYTHING, origin=None, robot="", greet=True, rate=30.0, reads=True):
        """Connect; `greet` sends the hello and what to show, `reads` acknowledges batches."""
        self.said, self.newest, self.closed = [], {}, None
        self.count, self.size = collections.Counter(), collections.Counter()
        self._reads = reads
        self._socket = Loop.run(self._connect(port, origin))
        if greet:
            self.send(do="hello", token=token, robot=robot)
            self.send(do="show", layers=dict.fromkeys(layers, rate))

    async def _connect(self, port, origin):
        headers = {} if origin is None else {"Origin": origin}
        request = tornado.httpclient.HTTPRequest(f"ws://127.0.0.1:{port}/socket", headers=headers)
        connection = await tornado.websocket.websocket_connect(request)
        self._task = asyncio.ensure_future(self._listen(connection))
        return connection

    async def _listen(self, connection):
        while True:
            message = await connection.read_message()
            if message is None:
                self.closed = (connection.close_code, connection.close_reason)
                return
            if isinstance(message, str):
                self.said.append(json.loads(message))
                continue
            for header, payload in parts_of(message):
                self.newest[header["layer"]] = (header, payload)
                self.count[header["layer"]] += 1
                self.size[header["layer"]] += len(payload) + len(json.dumps(header))
            if self._reads:
                await connection.write_message(json.dumps({"do": "ack", "number": number_of(message)}))

    def send(self, **wish):
        """Ask for something."""
        self.send_raw(json.dumps(wish))

    def send_raw(self, message):
        """Send a text or bytes as they are; an ended connection takes nothing."""
        async def write():
            try:
                await self._socket.write_message(message, isinstance(message, bytes))
            except tornado.websocket.WebSocketClosedError:
                pass

        Loop.run(write())

    def words(self, what):
        """Return what was said of one kind."""
        return [message for message in list(self.said) if message["say"] == what]

    def wait_for(self, what, since=0, timeout=30.0):
        """Return the first message of a kind after `since` of them."""
        return wait_until(
            lambda: self.words(what)[since:], f"'{what}' from web_view, which said {self.said[-3:]}", timeout
        )[0]

    def refusal(self, **wish):
        """Ask for something that is to be refused and return why."""
        before = len(self.words("refused"))
        self.send(**wish)
        return self.wait_for("refused", before)["why"]

    def layer(self, name, condition=lambda header: True, what="", timeout=30.0):
        """Return the header of a layer's newest part, once it meets a condition."""
        def met():
            found = self.newest.get(name)
            return [found[0]] if found and condition(found[0]) else None

        return wait_until(met, f"{name} {what}; it is {self.newest.get(name, ['nothing'])[0]}", timeout)[0]

    def cells(self, name):
        """Return the bytes of a grid's newest part."""
        return zlib.decompress(self.newest[name][1])

    def vanish(self):
        """End the connection without a word, as a phone does that leaves the room."""
        def drop():
            self._socket.protocol.stream.close()

        async def call():
            drop()

        Loop.run(call())

    def close(self):
        """End the connection."""
        async def call():
            self._socket.close()

        Loop.run(call())


class StalledClient:
    """A browser whose machine has gone to sleep: it asks for everything, and then reads nothing any more."""

    def __init__(self, port):
        self._socket = socket.create_connection(("127.0.0.1", port), 10.0)
        self._socket.sendall((
            f"GET /socket HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n").encode())
        assert b" 101 " in self._socket.recv(4096).split(b"\r\n")[0]
        shown = dict.fromkeys(EVERYTHING, 30)
        for wish in ({"do": "hello", "token": "", "robot": ""}, {"do": "show", "layers": shown}):
            text = json.dumps(wish).encode()
            size = bytes([0x80 | len(text)]) if len(text) < 126 else bytes([0x80 | 126]) + len(text).to_bytes(2, "big")
            self._socket.sendall(b"\x81" + size + bytes(4) + text)  # a masked text frame (RFC 6455), masked by zeros

    def close(self):
        """Wake up and leave."""
        self._socket.close()

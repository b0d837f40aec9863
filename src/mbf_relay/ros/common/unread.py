"""Messages that are received as bytes: of many that come only few are ever looked at, and some are just passed on."""

from __future__ import annotations

from typing import Any


def unread(message: Any) -> Any:
    """Return a class that is received and sent as `message` is and keeps its bytes; `read` makes the message of it."""

    class Unread(message):
        """Bytes under the name of their type."""

        __slots__ = ["bytes"]
        _has_header = False  # rospy would number it, in a field it does not have

        def __init__(self, *_args: Any, **_fields: Any) -> None:
            self.bytes = b""

        def serialize(self, buff: Any) -> None:
            """Write the bytes."""
            buff.write(self.bytes)

        def deserialize(self, data: bytes) -> Unread:
            """Keep the bytes."""
            self.bytes = bytes(data)
            return self

        def read(self) -> Any:
            """Return the message; raise rospy's or genpy's error where the bytes are none."""
            return message().deserialize(self.bytes)

    return Unread

"""Messages that are received as bytes and deserialized on demand: of most topics few messages are ever read."""

from __future__ import annotations

from typing import Any


def unread(message: Any) -> Any:
    """Return a subclass of a message class for subscribers and publishers that keeps the serialized bytes.

    Its attribute `bytes` has them; its method `read` deserializes them.
    """

    class Unread(message):
        """A message of that type as bytes."""

        __slots__ = ["bytes"]
        _has_header = False  # else rospy, when it publishes, would write header.seq, which this class lacks

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
            """Return the message; raise genpy.DeserializationError where the bytes are invalid."""
            return message().deserialize(self.bytes)

    return Unread

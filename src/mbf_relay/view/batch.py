"""The bytes on the wire: a batch of parts, each a small JSON header with a payload the header explains.

A part is two little-endian 32-bit lengths, the header as UTF-8 JSON, and the payload. A batch is its number, 32 bits,
and any number of parts. The page's `batch.js` reads what is written here.
"""

from __future__ import annotations

import json
import struct
from typing import Any, Dict, Iterable, Iterator, Tuple

_NUMBER = struct.Struct("<I")
_LENGTHS = struct.Struct("<II")


def part(header: Dict[str, Any], payload: bytes = b"") -> bytes:
    """Return one part; `header` names at least its layer and holds no NaN, which JSON does not know."""
    text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode("utf-8")
    return _LENGTHS.pack(len(text), len(payload)) + text + payload


def batch(number: int, parts: Iterable[bytes]) -> bytes:
    """Return parts as one message with the number by which the page acknowledges it."""
    return _NUMBER.pack(number) + b"".join(parts)


def number_of(message: bytes) -> int:
    """Return the number of a batch."""
    return int(_NUMBER.unpack_from(message)[0])


def parts_of(message: bytes) -> Iterator[Tuple[Dict[str, Any], bytes]]:
    """Yield the headers and payloads of a batch."""
    offset = _NUMBER.size
    while offset < len(message):
        header_length, payload_length = _LENGTHS.unpack_from(message, offset)
        begin = offset + _LENGTHS.size
        offset = begin + header_length + payload_length
        yield json.loads(message[begin:begin + header_length].decode("utf-8")), message[begin + header_length:offset]

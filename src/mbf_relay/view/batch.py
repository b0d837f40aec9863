"""The bytes on the wire: a batch of parts, each a small JSON header with a payload the header explains.

A part is two little-endian 32-bit lengths, the header as UTF-8 JSON, and the payload. A batch is its number, 32 bits,
and any number of parts. The page's `batch.js` reads what is written here.
"""

from __future__ import annotations

import json
import struct
from typing import Any, Dict, Iterable

_NUMBER = struct.Struct("<I")
_LENGTHS = struct.Struct("<II")


def part(header: Dict[str, Any], payload: bytes = b"") -> bytes:
    """Return one part; `header` names at least its layer and holds no NaN, which JSON does not know."""
    text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode("utf-8")
    return _LENGTHS.pack(len(text), len(payload)) + text + payload


def batch(number: int, parts: Iterable[bytes]) -> bytes:
    """Return parts as one message with the number by which the page acknowledges it."""
    return _NUMBER.pack(number) + b"".join(parts)

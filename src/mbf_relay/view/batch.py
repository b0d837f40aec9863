"""The binary messages to browsers: a batch of parts, each with a JSON header and a binary payload.

A part is two 32-bit lengths (little endian), the header as UTF-8 JSON, and the payload. A batch is its number (32 bits)
and any number of parts. The page's `batch.js` is the decoder.
"""

from __future__ import annotations

import json
import struct
from typing import Any, Dict, Iterable

_NUMBER = struct.Struct("<I")
_LENGTHS = struct.Struct("<II")


def part(header: Dict[str, Any], payload: bytes = b"") -> bytes:
    """Return one part; `header` has at least the key "layer" and no NaN or infinity, which JSON lacks."""
    text = json.dumps(header, separators=(",", ":"), allow_nan=False).encode("utf-8")
    return _LENGTHS.pack(len(text), len(payload)) + text + payload


def batch(number: int, parts: Iterable[bytes]) -> bytes:
    """Return parts as one message, with the number that the page acknowledges."""
    return _NUMBER.pack(number) + b"".join(parts)

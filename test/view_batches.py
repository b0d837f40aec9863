"""Reads what web_view sends, as its page does."""

import json
import struct

import numpy as np

TURN_UNIT = 1e-4  # rad


def number_of(message):
    """Return the number of a batch."""
    return struct.unpack_from("<I", message)[0]


def parts_of(message):
    """Yield the headers and payloads of a batch."""
    offset = 4
    while offset < len(message):
        header_length, payload_length = struct.unpack_from("<II", message, offset)
        begin = offset + 8
        offset = begin + header_length + payload_length
        yield json.loads(message[begin:begin + header_length].decode("utf-8")), message[begin + header_length:offset]


def points_from(header, payload):
    """Return the points of a part, shape (N, columns)."""
    if not header["count"]:
        return np.empty((0, 2))
    points = np.frombuffer(payload, dtype="<i2").reshape(-1, header["columns"]).astype(float)
    points[:, :2] = points[:, :2] * header["unit"] + header["origin"]
    points[:, 2:] *= TURN_UNIT
    return points

"""Messages as blind chance makes them, by their definitions: hypothesis' strategies."""

import genpy
from hypothesis import strategies as st
from roslib.message import get_message_class
from sensor_msgs.msg import PointField

INTEGERS = {"int8": (-128, 127), "uint8": (0, 255), "byte": (-128, 127), "char": (0, 255), "bool": (0, 1),
            "int16": (-2**15, 2**15 - 1), "uint16": (0, 2**16 - 1), "int32": (-2**31, 2**31 - 1),
            "uint32": (0, 2**32 - 1), "int64": (-2**63, 2**63 - 1), "uint64": (0, 2**64 - 1)}
TIMES = st.builds(genpy.Time, st.sampled_from([0, 1, 100, 2**31 - 1, 2**31, 2**32 - 1]), st.integers(0, 10**9 - 1))
NUMBERS = st.one_of(
    st.sampled_from([0.0, 1.0, -1.0, 0.05, 1e-6, 1e10, 1e300, -1e300, 5e-324]),
    st.sampled_from([float("nan"), float("inf"), float("-inf")]),
    st.floats(-10.0, 10.0))
WORDS = st.one_of(
    st.sampled_from(["", "map", "/map", "odom", "base_link", "a" * 1000, "\0", "\1", "é"]), st.text(max_size=5))
OWN = {
    PointField: st.builds(PointField, st.sampled_from(["x", "y", "z", "q"]), st.sampled_from([0, 4, 8, 2**32 - 1]),
                          st.sampled_from([0, 7, 8, 99]), st.sampled_from([0, 1, 2**32 - 1])),
}
"""Grammars of types of which blind chance would make nothing that gets beyond the first check."""


def values(kind):
    """Return a strategy for a field of a message definition's type."""
    if kind.endswith("]"):
        item, _, size = kind[:-1].partition("[")
        if item in ("uint8", "char"):
            return st.binary(min_size=int(size or 0), max_size=int(size or 64))
        return st.lists(values(item), min_size=int(size or 0), max_size=int(size or 6))
    if kind in INTEGERS:
        low, high = INTEGERS[kind]
        return st.one_of(st.integers(max(low, 0), min(high, 8)), st.sampled_from([low, high]))
    if kind in ("float32", "float64"):
        return NUMBERS
    if kind in ("time", "duration"):
        return TIMES
    return WORDS if kind == "string" else message(get_message_class("std_msgs/Header" if kind == "Header" else kind))


def message(kind):
    """Return a strategy for messages of a class."""
    if kind in OWN:
        return OWN[kind]
    fields = {name: values(slot) for name, slot in zip(kind.__slots__, kind._slot_types)}
    return st.fixed_dictionaries(fields).map(lambda made: kind(**made))

"""What comes from a browser is judged before anything comes of it."""

import contextlib
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbf_relay.view.limits import RateLimit
from mbf_relay.view.wishes import LONGEST, Refused, Wish, wish_from

GOAL = {"do": "goal", "x": 1.0, "y": -2, "theta": 0.5}
BAD = {
    "a position that is not a number": '{"do": "goal", "x": NaN, "y": 0, "theta": 0}',
    "a position without end": '{"do": "goal", "x": Infinity, "y": 0, "theta": 0}',
    "a position far beyond any map": json.dumps({**GOAL, "x": 1e9}),
    "a position of four hundred digits": json.dumps({**GOAL, "x": 10 ** 400}),
    "a text for a number": json.dumps({**GOAL, "x": "1"}),
    "a yes for a number": json.dumps({**GOAL, "x": True}),
    "a field too few": json.dumps({"do": "goal", "x": 1.0, "y": 0.0}),
    "a field too many": json.dumps({**GOAL, "z": 1.0}),
    "something nobody knows": '{"do": "explode"}',
    "a name that is none": '{"do": ["goal"]}',
    "nothing": "{}",
    "a list": "[1, 2]",
    "half a message": '{"do": "goal", "x": 1',
    "brackets without end": "[" * 5000,
    "too much": json.dumps({"do": "hello", "token": "x" * LONGEST, "robot": ""}),
    "bytes": b'{"do": "cancel"}',
    "too many waypoints": json.dumps({"do": "tour", "waypoints": [[0, 0, 0]] * 51, "loop": False, "pause": 0}),
    "no waypoint": json.dumps({"do": "tour", "waypoints": [], "loop": False, "pause": 0}),
    "a waypoint of two numbers": json.dumps({"do": "tour", "waypoints": [[0, 0]], "loop": False, "pause": 0}),
    "a pause for ever": json.dumps({"do": "tour", "waypoints": [[0, 0, 0]], "loop": False, "pause": 1e9}),
    "a stick beyond its end": json.dumps({"do": "stick", "forward": 5.0, "left": 0.0}),
    "a thousand layers": json.dumps({"do": "show", "layers": {str(number): 1 for number in range(1000)}}),
    "a layer without rate": json.dumps({"do": "show", "layers": {"scan": 0}}),
}


@pytest.mark.parametrize("words", BAD)
def test_refused_with_a_reason(words):
    with pytest.raises(Refused) as refusal:
        wish_from(BAD[words])
    assert 5 < len(str(refusal.value)) < 300


def test_a_wish_comes_through_with_its_values():
    assert wish_from(json.dumps(GOAL)) == Wish("goal", {"x": 1.0, "y": -2.0, "theta": 0.5})
    assert wish_from('{"do": "cancel"}') == Wish("cancel", {})
    tour = wish_from(json.dumps({"do": "tour", "waypoints": [[1, 2, 3]], "loop": True, "pause": 2}))
    assert tour.values["waypoints"] == [(1.0, 2.0, 3.0)]


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=20),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(st.sampled_from(["do", "x", "waypoints", "layers"]), inner, max_size=4)
        ),
        max_leaves=12,
    )
)
def test_whatever_comes_is_a_wish_or_refused(value):
    with contextlib.suppress(Refused):
        wish_from(json.dumps(value))


def test_a_flood_is_stopped_and_patience_fills_the_bucket_again():
    limit = RateLimit(10.0, 5.0)
    assert [limit.allows(100.0) for _ in range(7)] == [True] * 5 + [False] * 2
    assert limit.allows(100.2)
    assert sum(limit.allows(101.0 + 0.01 * tick) for tick in range(1000)) <= 5 + 100 + 1

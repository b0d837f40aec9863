"""Whatever stands on the parameter server under our names is taken and sound, or refused in one line."""

import dataclasses
import importlib
import math
import pkgutil

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tally import how_many, trial

import mbf_relay
from mbf_relay.parameters import ParameterSet

NUMBERS = st.one_of(
    st.sampled_from([0, 1, -1, 0.0, 1e-300, 1e300, -1e300, 2**31, 2**63, 2**70, math.nan, math.inf, -math.inf]),
    st.floats(), st.integers())
WORDS = st.one_of(
    st.sampled_from(["", "map", "[[0, 0], [1, 0], [0, 1]]", "[[nan, 0]]", "true", "1e5"]), st.text(max_size=5))
VALUES = st.recursive(
    st.one_of(st.none(), st.booleans(), NUMBERS, WORDS),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(WORDS, inner, max_size=2)), max_leaves=6)


def parameter_sets():
    """Return every declared set of the rooms below ros/, which need no ROS to be imported."""
    for module in pkgutil.walk_packages(mbf_relay.__path__, "mbf_relay."):
        if not module.name.startswith(("mbf_relay.ros", "mbf_relay.kernel_build")):
            try:
                importlib.import_module(module.name)
            except ImportError as error:  # what a room needs may not be installed here; our own is
                if (error.name or "mbf_relay").startswith("mbf_relay"):
                    raise
    found, pending = {}, [ParameterSet]
    while pending:
        kinds = pending.pop().__subclasses__()
        pending += kinds
        found.update({f"{k.__module__}.{k.__qualname__}": k for k in kinds if k.__module__.startswith("mbf_relay.")})
    return [found[name] for name in sorted(found)]


@pytest.mark.parametrize("kind", parameter_sets(), ids=lambda kind: kind.__qualname__)
@settings(max_examples=how_many(10, 1000))
@given(data=st.data())
def test_a_node_given_any_values_has_sound_ones_or_says_in_a_line_what_is_wrong(kind, data):
    with trial("parameters of any kind read"):
        values = data.draw(st.dictionaries(st.sampled_from(kind.names()), VALUES) if kind.names() else st.just({}))
        try:
            made, notes = kind.read(values)
        except ValueError as error:
            assert str(error) and "\n" not in str(error)
            return
        assert all("\n" not in note for note in notes)
        defaults = {field.name: field.default for field in dataclasses.fields(kind)}
        for name, value in vars(made).items():
            if isinstance(value, float) and not math.isfinite(value):
                assert value == defaults[name], f"{name} is {value}"

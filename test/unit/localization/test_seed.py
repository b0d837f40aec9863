"""The seed that amcl is given."""

import pytest

from mbf_relay.localization.node_parameters import seed_from


@pytest.mark.parametrize("given, seed", [({}, 7), ({"seed": 0}, 0), ({"seed": 3.0}, 3)])
def test_a_seed_is_taken_as_it_is_or_made_up(given, seed):
    assert seed_from(given, 7) == (seed, "")


@pytest.mark.parametrize("nonsense", [-1, 1.5, float("inf"), float("nan"), True, "any"])
def test_a_robot_is_localized_though_its_seed_is_none(nonsense):
    seed, note = seed_from({"seed": nonsense}, 7)
    assert seed == 7 and note.startswith("parameter seed is ") and note.endswith(": 7 is used")

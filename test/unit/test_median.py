"""The median is NumPy's own, to the last bit: drives do not depend on who takes it."""

import numpy as np
import pytest

from mbf_relay.median import median


@pytest.mark.parametrize("shape", [(1,), (2,), (7,), (8,), (20, 2), (9, 3)])
def test_it_is_numpys_to_the_last_bit(shape):
    for seed in range(50):
        values = np.random.default_rng(seed).normal(0.0, 10.0 ** (seed % 7 - 3), shape)
        assert np.array_equal(median(values), np.median(values, axis=0))

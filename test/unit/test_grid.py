"""Cells and points of a grid."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbf_relay.grid import Grid

GRID = Grid(0.05, -10.0, -4.0, 384, 200)


@given(st.integers(-500, 900), st.integers(-500, 900))
def test_the_centre_of_a_cell_lies_in_that_cell(column, row):
    assert GRID.cell_at(*GRID.center_of(column, row)) == (column, row)


@given(st.lists(st.tuples(st.floats(-30, 30), st.floats(-30, 30)), min_size=1, max_size=20))
def test_arrays_give_what_single_points_give(points):
    cells = GRID.cells_at(np.array(points))
    assert [tuple(cell) for cell in cells] == [GRID.cell_at(*point) for point in points]
    assert list(GRID.contains_cells(cells)) == [GRID.contains_point(*point) for point in points]
    np.testing.assert_allclose(GRID.centers_of(cells), [GRID.center_of(*cell) for cell in cells])


def test_a_point_left_of_the_origin_is_not_in_the_first_cell():
    assert GRID.cell_at(-10.01, -3.99) == (-1, 0)
    assert not GRID.contains_point(-10.01, -3.99)


def test_the_far_edges_are_outside():
    assert GRID.contains_point(-10.0, -4.0)
    assert not GRID.contains_cell(384, 0)
    assert not GRID.contains_cell(0, 200)


@pytest.mark.parametrize("x, y", [(math.nan, 0.0), (0.0, math.inf)])
def test_no_cell_holds_a_point_that_is_not_finite(x, y):
    assert not GRID.contains_point(x, y)


@pytest.mark.parametrize("resolution", [0.0, -0.05, math.nan, math.inf])
def test_a_grid_without_a_cell_size_is_refused_with_the_value(resolution):
    with pytest.raises(ValueError, match=str(resolution)):
        Grid(resolution, 0.0, 0.0, 1, 1)

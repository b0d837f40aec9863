"""What a browser gets: what it has not seen, nothing twice, and never a queue."""

import math
import zlib

import numpy as np
import pytest
from view_batches import number_of, parts_of, points_from

from mbf_relay.geometry import Pose2D
from mbf_relay.view.batch import part
from mbf_relay.view.feed import WINDOW, Feed
from mbf_relay.view.layers import Journal, Newest
from mbf_relay.view.points import points_part, thinned
from mbf_relay.view.tiles import PORTION, TILE, GridShape, TiledGrid

SHAPE = GridShape(150, 130, 0.05, Pose2D(-1.0, 2.0, 0.0), "map")


def content(message):
    return [(header["layer"], header) for header, _ in parts_of(message)]


class Page:
    """A browser's end: keeps the cells it was sent."""

    def __init__(self):
        self.cells = None
        self.seen = 0
        self.tiles = 0

    def pull(self, grid):
        """Take parts until there is nothing new; return how many tiles came."""
        before = self.tiles
        while True:
            encoded, self.seen = grid.take(self.seen)
            if encoded is None:
                return self.tiles - before
            header, payload = next(parts_of(b"\0\0\0\0" + encoded))
            self.take(header, np.frombuffer(zlib.decompress(payload), dtype=np.uint8))

    def take(self, header, values):
        if self.cells is None or self.cells.shape != (header["height"], header["width"]):
            self.cells = np.full((header["height"], header["width"]), 255, dtype=np.uint8)
        across, offset = math.ceil(header["width"] / header["tile"]), 0
        for index in header["tiles"]:
            row, column = index // across * header["tile"], index % across * header["tile"]
            window = self.cells[row:row + header["tile"], column:column + header["tile"]]
            window[:] = values[offset:offset + window.size].reshape(window.shape)
            offset += window.size
            self.tiles += 1
        assert offset == len(values)


def random_cells(shape, seed=1):
    return np.random.default_rng(seed).integers(-1, 101, shape.width * shape.height).astype(np.int8)


def test_a_page_has_the_grid_cell_by_cell_whatever_comes():
    grid, page, other = TiledGrid("map", 0.0), Page(), Page()
    cells = random_cells(SHAPE).reshape(SHAPE.height, SHAPE.width)
    grid.replace(SHAPE, cells.ravel())
    page.pull(grid)
    rng = np.random.default_rng(2)
    for _ in range(30):
        column, row = int(rng.integers(0, 100)), int(rng.integers(0, 100))
        width, height = int(rng.integers(1, 50)), int(rng.integers(1, 30))
        window = rng.integers(-1, 101, (height, width)).astype(np.int8)
        cells[row:row + height, column:column + width] = window
        grid.update(column, row, width, window.ravel())
        if rng.random() < 0.5:
            page.pull(grid)
    page.pull(grid)
    other.pull(grid)
    np.testing.assert_array_equal(page.cells.view(np.int8), cells)
    np.testing.assert_array_equal(other.cells.view(np.int8), cells)


def test_one_changed_cell_sends_one_tile_and_the_same_grid_again_sends_none():
    grid, page = TiledGrid("map", 0.0), Page()
    cells = random_cells(SHAPE)
    grid.replace(SHAPE, cells)
    assert page.pull(grid) == math.ceil(150 / TILE) * math.ceil(130 / TILE)
    grid.replace(SHAPE, cells)
    assert page.pull(grid) == 0
    cells = cells.copy()
    cells[70 * 150 + 70] = 7 if cells[70 * 150 + 70] != 7 else 8
    grid.replace(SHAPE, cells)
    assert page.pull(grid) == 1


def test_a_grid_elsewhere_is_sent_whole():
    grid, page = TiledGrid("local", 0.0), Page()
    grid.replace(SHAPE, random_cells(SHAPE))
    page.pull(grid)
    grid.replace(SHAPE._replace(origin=Pose2D(0.0, 0.0, 0.0)), random_cells(SHAPE))
    assert page.pull(grid) == 9


def test_a_large_map_comes_in_portions():
    shape = GridShape(TILE * 20, TILE * 20, 0.05, Pose2D(0.0, 0.0, 0.0), "map")
    grid = TiledGrid("map", 0.0)
    grid.replace(shape, np.zeros(shape.width * shape.height, dtype=np.int8))
    first, seen = grid.take(0)
    header, _ = next(parts_of(b"\0\0\0\0" + first))
    assert len(header["tiles"]) == PORTION
    assert seen < grid.revision
    page = Page()
    assert page.pull(grid) == 400


@pytest.mark.parametrize(
    "column, row, width, count", [(-1, 0, 5, 5), (149, 0, 2, 2), (0, 129, 3, 6), (0, 0, 3, 4), (0, 0, 0, 0)]
)
def test_a_window_that_does_not_lie_in_the_grid_is_refused(column, row, width, count):
    grid = TiledGrid("map", 0.0)
    grid.replace(SHAPE, random_cells(SHAPE))
    with pytest.raises(ValueError):
        grid.update(column, row, width, np.zeros(count, dtype=np.int8))


def test_a_grid_whose_size_does_not_fit_its_cells_is_refused():
    with pytest.raises(ValueError):
        TiledGrid("map", 0.0).replace(SHAPE, np.zeros(10, dtype=np.int8))


def test_points_come_back_within_their_unit_and_without_what_is_not_finite():
    rng = np.random.default_rng(3)
    poses = np.column_stack((rng.uniform(-30, 50, (200, 2)), rng.uniform(-math.pi, math.pi, 200)))
    poses[7, 0], poses[8, 2] = np.nan, np.inf
    header, payload = next(parts_of(b"\0\0\0\0" + points_part("particles", poses, 500)))
    back = points_from(header, payload)
    kept = np.delete(poses, (7, 8), axis=0)
    assert back.shape == kept.shape
    assert np.abs(back - kept)[:, :2].max() <= header["unit"]
    assert np.abs(back - kept)[:, 2].max() <= 1e-4


def test_no_point_at_all_is_a_part_too():
    header, payload = next(parts_of(b"\0\0\0\0" + points_part("scan", np.empty((0, 2)), 10)))
    assert len(points_from(header, payload)) == 0


def test_thinning_keeps_both_ends():
    points = thinned(np.arange(100.0)[:, None], 7)
    assert len(points) == 7
    assert (points[0, 0], points[-1, 0]) == (0.0, 99.0)


def test_a_browser_that_stops_reading_finds_the_newest_and_not_a_queue():
    layer, feed = Newest("scan", 0.0), Feed()
    layers = {"scan": layer}
    feed.want({"scan": 0.0})
    sent = []
    for number in range(50):
        layer.show({"number": number})
        message = feed.next_batch(layers, float(number))
        if message is not None:
            sent.append(message)
    assert len(sent) == WINDOW
    feed.acknowledge(number_of(sent[-1]))
    assert content(feed.next_batch(layers, 50.0)) == [("scan", {"layer": "scan", "number": 49})]
    assert feed.next_batch(layers, 51.0) is None


def test_an_acknowledgement_of_what_was_never_sent_opens_nothing():
    layer, feed = Newest("scan", 0.0), Feed()
    feed.want({"scan": 0.0})
    for number in range(5):
        layer.show({"number": number})
        feed.next_batch({"scan": layer}, float(number))
    feed.acknowledge(10 ** 9)
    assert feed.in_flight == WINDOW


def test_a_layer_comes_no_oftener_than_asked_and_no_oftener_than_it_may():
    layer, feed = Newest("scan", 0.5), Feed()
    feed.want({"scan": 0.2})
    count = 0
    for tick in range(100):
        layer.show({"number": tick})
        message = feed.next_batch({"scan": layer}, 0.1 * tick)
        if message is not None:
            count += 1
            feed.acknowledge(number_of(message))
    assert 19 <= count <= 21


def test_what_is_switched_off_is_not_sent_and_comes_whole_when_switched_on_again():
    layer, feed = Newest("scan", 0.0), Feed()
    layer.show({"number": 1})
    feed.want({"map": 0.0})
    assert feed.next_batch({"scan": layer}, 0.0) is None
    for _ in range(2):
        feed.want({"scan": 0.0})
        message = feed.next_batch({"scan": layer}, 1.0)
        assert content(message)[0][0] == "scan"
        feed.acknowledge(number_of(message))
        feed.want({})


def test_a_scan_nobody_takes_is_never_encoded():
    layer, made = Newest("scan", 0.0), []
    for number in range(3):
        layer.put(lambda number=number: (made.append(number), part({"layer": "scan", "number": number}))[1])
    assert made == []
    layer.take(0)
    layer.take(0)
    assert made == [2]


def test_the_same_again_is_no_news():
    layer = Newest("robot", 0.0)
    layer.show({"pose": [1, 2, 3]})
    seen = layer.revision
    layer.show({"pose": [1, 2, 3]})
    assert layer.revision == seen


def test_a_warning_is_told_once_and_a_flood_pushes_out_the_oldest():
    journal = Journal("log", 0.0, 3)
    for number in range(2):
        journal.add(number)
    encoded, seen = journal.take(0)
    assert next(parts_of(b"\0\0\0\0" + encoded))[0]["entries"] == [0, 1]
    assert journal.take(seen)[0] is None
    for number in range(2, 12):
        journal.add(number)
    encoded, seen = journal.take(seen)
    assert next(parts_of(b"\0\0\0\0" + encoded))[0]["entries"] == [9, 10, 11]

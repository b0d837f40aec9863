# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops of the search for a scan all over a map: branch and bound over a pyramid of best scores."""

from __future__ import annotations

import numpy as np

from mbf_relay.kernels import kernel


@kernel("float64(int64, int64, int64, int64, int32[:,:,::1], uint8[::1], int64[:,::1], float64)")
def bound_of(level, row, column, turn, offsets, scores, levels, least):
    """Return an upper bound of a scan's score with the robot in a block of cells, or 0 where it is below `least`.

    Args:
        level: Of the pyramid; a block has 2^level cells a side.
        row, column: Of the block.
        turn: Index of the heading.
        offsets: Where the beams end (cells from the robot) at each heading, shape (turns, B, 2), as column and row.
        scores: The pyramid: at each block the best score of 2 x 2 blocks from it on, levels one after the other, each
            with a row and a column of blocks before the map's first.
        levels: Where a level begins in `scores`, its rows and its columns, shape (L, 3).
        least: Smallest score of interest.
    """
    begin, height, width = levels[level, 0], levels[level, 1], levels[level, 2]
    row0, column0 = row << level, column << level
    beams, total = offsets.shape[1], 0
    spare = 255 * beams - least  # by which beams may fall short in total
    for j in range(beams):
        x = (column0 + offsets[turn, j, 0]) >> level
        y = (row0 + offsets[turn, j, 1]) >> level
        if x >= -1 and y >= -1 and x < width and y < height:
            total += scores[begin + (y + 1) * (width + 1) + x + 1]
        if 255 * (j + 1) - total > spare:
            return 0.0
    return float(total)


@kernel(
    "UniTuple(int64, 2)(int64, int64, int64[:,::1], uint16[::1], int64[::1], int32[:,:,::1], uint8[::1],"
    " int64[:,::1], uint8[::1], float64, int64, float64[:,::1])"
)
def descend(leaf, top, blocks, bounds, order, offsets, scores, levels, free, margin, most_visits, found):
    """Find the best place in every block that may hold one nearly as good as the best of all.

    Depth first from the most promising block on, each block's best child first (Hess et al. 2016, algorithm 3), but
    every block keeps a place of its own: what looks alike is found, too.

    Args:
        leaf: Level at which places are told apart.
        top, blocks, bounds: As `bound_all` leaves them.
        order: Which of the bounds to look at, most promising first, shape (K,).
        offsets, scores, levels: As for `bound_of`.
        free: Laid out as `scores`: whether the robot can be in a block.
        margin: How far below the best a place may score.
        most_visits: Blocks to look at before the search ends with what it has.
        found: Result, room for a row of each of these: score, row, column (in leaf's blocks) and heading's index.

    Returns:
        How many were found, and at how many of `order` it looked, -1 where no other may hold such a place.
    """
    count, looked, best, visits, turns = 0, 0, 0.0, 0, offsets.shape[0]
    stack = np.empty((4 * 32, 3), dtype=np.int64)
    stack_bounds = np.empty(4 * 32)
    for node in order:
        if bounds[node] < best - margin:
            return count, -1
        if visits > most_visits:
            return count, looked
        looked += 1
        block, turn = node // turns, node % turns
        stack[0, 0], stack[0, 1], stack[0, 2] = top, blocks[block, 0], blocks[block, 1]
        stack_bounds[0] = bounds[node]
        depth = 1
        own, own_row, own_column = -1.0, 0, 0
        while depth > 0:
            depth -= 1
            bound = stack_bounds[depth]
            if bound <= own or bound < best - margin:
                continue
            level, row, column = stack[depth, 0], stack[depth, 1], stack[depth, 2]
            if level == leaf:
                own, own_row, own_column = bound, row, column
                best = max(best, own)
                continue
            visits += 1
            below = level - 1
            begin, height, width = levels[below, 0], levels[below, 1], levels[below, 2]
            first = depth
            for child in range(4):
                y, x = 2 * row + child // 2, 2 * column + child % 2
                if y >= height or x >= width or free[begin + (y + 1) * (width + 1) + x + 1] == 0:
                    continue
                least = max(own + 1.0, best - margin)
                value = bound_of(below, y, x, turn, offsets, scores, levels, least)
                if value < least:
                    continue
                place = depth
                while place > first and stack_bounds[place - 1] > value:
                    stack_bounds[place] = stack_bounds[place - 1]
                    for i in range(3):
                        stack[place, i] = stack[place - 1, i]
                    place -= 1
                stack_bounds[place] = value
                stack[place, 0], stack[place, 1], stack[place, 2] = below, y, x
                depth += 1
        if own >= 0.0:
            found[count, 0], found[count, 1], found[count, 2], found[count, 3] = own, own_row, own_column, turn
            count += 1
    return count, -1 if looked == len(bounds) else looked


@kernel("void(uint16[::1], uint8[::1])")
def add(sums, scores):
    """Add scores to sums, of one shape: on its own, as a loop that compilers find wide vectors for."""
    for x in range(len(sums)):
        sums[x] += scores[x]


@kernel("void(int64, int64[:,::1], int32[:,:,::1], uint8[::1], int64[:,::1], uint16[::1])")
def bound_all(top, blocks, offsets, scores, levels, bounds):
    """Compute the upper bounds of a scan's score in blocks at every heading: `bound_of` for a row of blocks at once.

    Args:
        top: Level of the blocks.
        blocks: Row and column of each, shape (R, 2), one row after the other.
        offsets, scores, levels: As for `bound_of`.
        bounds: Result, shape (R * turns,): of one block after the other at all headings; a large map has millions.
    """
    begin, height, width = levels[top, 0], levels[top, 1], levels[top, 2]
    turns, sums = offsets.shape[0], np.empty(width, dtype=np.uint16)
    first = 0
    while first < len(blocks):
        row, end = blocks[first, 0], first
        while end < len(blocks) and blocks[end, 0] == row:
            end += 1
        for turn in range(turns):
            sums[:] = 0
            for j in range(offsets.shape[1]):
                y, shift = row + (offsets[turn, j, 1] >> top), offsets[turn, j, 0] >> top
                left, right = max(blocks[first, 1], -1 - shift), min(blocks[end - 1, 1] + 1, width - shift)
                if -1 <= y < height and left < right:
                    place = begin + (y + 1) * (width + 1) + shift + 1
                    add(sums[left:right], scores[place + left:place + right])
            for block in range(first, end):
                bounds[block * turns + turn] = sums[blocks[block, 1]]
        first = end


@kernel("void(uint16[::1], int64[::1])")
def best_first(bounds, order):
    """Find the highest bounds, highest first and the earlier of equals first, by counting how often each occurs.

    Args:
        bounds: Shape (N,).
        order: Result, the indices of as many as fit, shape (K,), K at most N.
    """
    counts, places, total = np.zeros(1 << 16, dtype=np.int64), np.empty(1 << 16, dtype=np.int64), 0
    for i in range(len(bounds)):
        counts[bounds[i]] += 1
    for bound in range(len(counts) - 1, -1, -1):
        places[bound] = total
        total += counts[bound]
    for i in range(len(bounds)):
        place = places[bounds[i]]
        if place < len(order):
            order[place] = i
            places[bounds[i]] += 1

# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled flood fills: reachable cells, ways out of blocked cells, and the bottleneck of the widest path."""

from __future__ import annotations

import numpy as np

from mbf_relay.kernels import kernel

_CANCEL_CHECK = 8191  # cells between two checks of the flag, less one


@kernel("boolean(uint8[:,::1], boolean[::1], int64, int64, float64, float64, float64, int64, uint8[:,::1], uint8[::1])")
def flood_towards(costs, free, start_x, start_y, goal_x, goal_y, radius, further, reached, cancelled):
    """Mark the free cells connected with a start, in order of distance, until some steps after the first near a goal.

    Args:
        costs: Shape (height, width).
        free: Shape (256,): whether cells of each cost may be entered.
        start_x, start_y: Column and row of a free cell.
        goal_x, goal_y: The goal in cells, centres at halves; it may lie outside.
        radius: Distance (cells) up to which a cell counts as near the goal.
        further: Steps (4-connected) to go on after the first cell near the goal was marked.
        reached: Shape of `costs`, all 0; set to 1 where a cell is marked.
        cancelled: Shape (1,), non-zero to stop.

    Returns:
        False where it was cancelled.
    """
    height, width = costs.shape
    enough = radius * radius * (1.0 + 1e-12) + 1e-9
    queue = np.empty(1024, np.int64)
    queue[0] = start_y * width + start_x
    reached[start_y, start_x] = 1
    is_near = (start_x + 0.5 - goal_x) ** 2 + (start_y + 0.5 - goal_y) ** 2 <= enough
    done, count, step_ends = 0, 1, 1
    while done < count:
        if done & _CANCEL_CHECK == 0 and cancelled[0] != 0:
            return False
        if done == step_ends:
            if is_near:
                further -= 1
                if further <= 0:
                    break
            step_ends = count
        y, x = queue[done] // width, queue[done] % width
        done += 1
        if count + 4 > queue.shape[0]:
            if done > queue.shape[0] // 2:  # its front half is processed
                queue[:count - done] = queue[done:count].copy()
                count -= done
                step_ends -= done
                done = 0
            else:
                longer = np.empty(2 * queue.shape[0], np.int64)
                longer[:count] = queue[:count]
                queue = longer
        for side in range(4):
            near_x = x + (side * 2 - 1 if side < 2 else 0)
            near_y = y + (side * 2 - 5 if side > 1 else 0)
            if 0 <= near_x < width and 0 <= near_y < height and reached[near_y, near_x] == 0:
                if free[costs[near_y, near_x]]:
                    reached[near_y, near_x] = 1
                    is_near = is_near or (near_x + 0.5 - goal_x) ** 2 + (near_y + 0.5 - goal_y) ** 2 <= enough
                    queue[count] = near_y * width + near_x
                    count += 1
    return True


@kernel("int64(uint8[:,::1], boolean[::1], boolean[::1], int64, int64, int64, int32[:,::1])")
def way_out(costs, free, passable, start_x, start_y, reach, path):
    """Find the shortest path (4-connected) from a cell that is not free, over passable cells, to the nearest free cell.

    Args:
        costs: Shape (height, width).
        free, passable: Shape (256,): whether cells of each cost are free, and whether the path may cross them.
        start_x, start_y: Column and row of the cell to leave.
        reach: Largest distance (cells) of the free cell, in columns and in rows.
        path: Shape (M, 2), M at least (2 reach + 1)²; filled with columns and rows, the free cell last.

    Returns:
        Number of cells of the path, 0 where there is none.
    """
    height, width = costs.shape
    side = 2 * reach + 1
    before = np.full((side, side), -2, np.int64)
    queue = np.empty(side * side, np.int64)
    queue[0] = reach * side + reach
    before[reach, reach] = -1
    done, count = 0, 1
    found = -1
    while done < count:
        here = queue[done]
        done += 1
        row, column = here // side, here % side
        if free[costs[start_y + row - reach, start_x + column - reach]]:
            found = here
            break
        for k in range(4):
            to_column = column + (k * 2 - 1 if k < 2 else 0)
            to_row = row + (k * 2 - 5 if k > 1 else 0)
            if not (0 <= to_column < side and 0 <= to_row < side) or before[to_row, to_column] != -2:
                continue
            x, y = start_x + to_column - reach, start_y + to_row - reach
            if 0 <= x < width and 0 <= y < height and (passable[costs[y, x]] or free[costs[y, x]]):
                before[to_row, to_column] = here
                queue[count] = to_row * side + to_column
                count += 1
    length = 0
    while found >= 0:
        path[length, 0] = start_x + found % side - reach
        path[length, 1] = start_y + found // side - reach
        length += 1
        found = before[found // side, found % side]
    for n in range(length // 2):
        for axis in range(2):
            path[n, axis], path[length - 1 - n, axis] = path[length - 1 - n, axis], path[n, axis]
    return length


@kernel("int64(uint8[:,::1], int64[::1], int64, int64, uint8[::1])")
def first_joint(room, order, one, other, cancelled):
    """Join cells with their neighbours (4-connected) in a given order until two of them are connected (union-find).

    Args:
        room: Only its shape, (height, width), is used.
        order: Shape (N,): the cells in the order of joining, as row * width + column.
        one, other: The two cells to connect, as in `order`.
        cancelled: Shape (1,), non-zero to stop.

    Returns:
        The cell that connected them; -1 where they stay unconnected, or where it was cancelled.
    """
    height, width = room.shape
    parents = np.full(height * width, -1, np.int32)
    for n in range(order.shape[0]):
        if n & _CANCEL_CHECK == 0 and cancelled[0] != 0:
            return -1
        cell = order[n]
        parents[cell] = cell
        row, column = cell // width, cell % width
        for side in range(4):
            near_column = column + (side * 2 - 1 if side < 2 else 0)
            near_row = row + (side * 2 - 5 if side > 1 else 0)
            if not (0 <= near_column < width and 0 <= near_row < height):
                continue
            root = np.int64(near_row * width + near_column)
            if parents[root] < 0:
                continue
            while parents[root] != root:
                parents[root] = parents[parents[root]]
                root = parents[root]
            mine = cell
            while parents[mine] != mine:
                parents[mine] = parents[parents[mine]]
                mine = parents[mine]
            parents[mine] = root
        if parents[one] >= 0 and parents[other] >= 0:
            here, there = one, other
            while parents[here] != here:
                parents[here] = parents[parents[here]]
                here = parents[here]
            while parents[there] != there:
                parents[there] = parents[parents[there]]
                there = parents[there]
            if here == there:
                return cell
    return -1

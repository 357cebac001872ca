"""Compiled loops over a flat map: the cheapest way to a target, and how far a direction is known to be free.

Maps have the shape (rows along y, columns along x); positions on them are (x, y) in cells, of which cell (row, column)
has its middle at (column, row).
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import float32, float64, int64, uint8, void

from voxdepth.compiled import FLOAT_IMAGE, compiled, named_tuple
from voxdepth.types import FloatArray, FloatImage

from .obstacle_kernels import braking_speed

Bytes = npt.NDArray[np.uint8]
Cells = npt.NDArray[np.int64]
Costs = npt.NDArray[np.float32]
STEP_CELLS = 0.5
"""Distance between the places at which a direction is tested."""
ESCAPE_SLOPE = 0.5
"""Growth of the clearance per distance that a drone keeps on its way out of a place that is too narrow."""
GOOD_ENOUGH = 0.7
"""Share of the wanted speed with which a direction needs no better one."""
DIAGONAL = float(np.sqrt(2))


@compiled(float64(FLOAT_IMAGE, float64, float64))
def clearance_at(clearance: FloatImage, x: float, y: float) -> float:
    """Return the clearance at a position; 0 beyond the map."""
    col, row = int(np.floor(x + 0.5)), int(np.floor(y + 0.5))
    if 0 <= row < clearance.shape[0] and 0 <= col < clearance.shape[1]:
        return float(clearance[row, col])
    return 0.0


@compiled(float64(FLOAT_IMAGE, float64, float64, float64, float64, float64, float64))
def free_length(
    clearance: FloatImage, x: float, y: float, along_x: float, along_y: float, width: float, longest: float
) -> float:
    """Return how far a body may move from a position in a direction before its clearance is less than its width.

    Everything is in cells. A body that stands too narrow may leave in directions in which the clearance grows.
    """
    here = clearance_at(clearance, x, y)
    length = 0.0
    while length < longest:
        ahead = length + STEP_CELLS
        least = min(width, here + ESCAPE_SLOPE * (ahead - 2 * STEP_CELLS))
        if clearance_at(clearance, x + ahead * along_x, y + ahead * along_y) < least:
            return length
        length = ahead
    return longest


class Braking(NamedTuple):
    """How a body keeps to free space; lengths in metres."""

    cell_m: float
    """Side of a cell of the map."""
    width_m: float
    """Clearance that the body needs."""
    longest_m: float
    """Free lengths are sought up to this one."""
    decel_m_s2: float
    gain_per_s: float


BRAKING = named_tuple(Braking, *[float64] * len(Braking._fields))


@compiled(float64(float64[:, ::1], float64[::1], float64, float64))
def approach_limit(towards: FloatArray, speed_m_s: FloatArray, along_x: float, along_y: float) -> float:
    """Return the largest speed in a horizontal direction that respects limits along `towards`, shape (n, 2 or 3)."""
    least = np.inf
    for k in range(len(towards)):
        share = towards[k, 0] * along_x + towards[k, 1] * along_y
        if share > 1e-3:
            least = min(least, max(0.0, speed_m_s[k] / share))
    return least


@compiled(void(FLOAT_IMAGE, float64, float64, float64[:, ::1], float64[::1], float64[::1], BRAKING, float64[::1]))
def nearest_safe_velocity(
    clearance: FloatImage,
    x: float,
    y: float,
    towards: FloatArray,
    speed_m_s: FloatArray,
    sidesteps_rad: FloatArray,
    braking: Braking,
    # output
    velocity: FloatArray,
) -> None:
    """Turn and shorten a velocity (x, y), in place, so that a body can stop within free space.

    It starts at (x, y), in cells. Directions beside the wanted one also respect the limits towards other bodies, which
    the wanted one does already. A direction that keeps `GOOD_ENOUGH` of the speed is not compared with further ones.
    """
    speed = np.sqrt(velocity[0] ** 2 + velocity[1] ** 2)
    wanted_x, wanted_y = velocity / max(speed, 1e-9)
    velocity[:] = 0.0
    most = 0.0
    for k in range(len(sidesteps_rad)):
        cos, sin = np.cos(sidesteps_rad[k]), np.sin(sidesteps_rad[k])
        along_x, along_y = cos * wanted_x - sin * wanted_y, sin * wanted_x + cos * wanted_y
        width, longest = braking.width_m / braking.cell_m, braking.longest_m / braking.cell_m
        free_m = braking.cell_m * free_length(clearance, x, y, along_x, along_y, width, longest)
        allowed = min(speed, braking_speed(free_m, braking.decel_m_s2, braking.gain_per_s))
        if k > 0:
            allowed = min(allowed, approach_limit(towards, speed_m_s, along_x, along_y))
        if allowed * cos > most + 1e-6:
            velocity[0], velocity[1], most = allowed * along_x, allowed * along_y, allowed * cos
        if most >= GOOD_ENOUGH * speed:
            break


@compiled(int64(float64[::1], int64[::1], int64, float64, int64))
def push(keys: FloatArray, items: Cells, n: int, key: float, item: int) -> int:
    """Add an item to a binary heap of `n` items; return their number."""
    place = n
    while place > 0 and keys[(place - 1) // 2] > key:
        keys[place], items[place] = keys[(place - 1) // 2], items[(place - 1) // 2]
        place = (place - 1) // 2
    keys[place], items[place] = key, item
    return n + 1


@compiled(int64(float64[::1], int64[::1], int64))
def pop(keys: FloatArray, items: Cells, n: int) -> int:
    """Remove the first item, whose place is 0, from a binary heap of `n` items; return how many are left."""
    n -= 1
    key, item, place = keys[n], items[n], 0
    while 2 * place + 1 < n:
        child = 2 * place + 1
        if child + 1 < n and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[place], items[place] = keys[child], items[child]
        place = child
    keys[place], items[place] = key, item
    return n


@compiled(int64(FLOAT_IMAGE, float64, int64, float32[::1], int64[::1], float64[::1], int64[::1], int64))
def spread(
    price: FloatImage, paid: float, cell: int, cost: Costs, towards: Cells, keys: FloatArray, items: Cells, n: int
) -> int:
    """Offer the ways through a cell to its neighbours; return the size of the heap of those to visit."""
    n_rows, n_cols = price.shape
    i, j = cell // n_cols, cell % n_cols
    for a in range(max(i - 1, 0), min(i + 2, n_rows)):
        for b in range(max(j - 1, 0), min(j + 2, n_cols)):
            length = DIAGONAL if a != i and b != j else 1.0
            total = np.float32(paid + length * 0.5 * (price[i, j] + price[a, b]))
            other = a * n_cols + b
            if total < cost[other]:
                cost[other], towards[other] = total, cell
                n = push(keys, items, n, float(total), other)
    return n


@compiled(int64(FLOAT_IMAGE, FLOAT_IMAGE, int64, int64, int64[::1]))
def cheapest_way(price: FloatImage, left: FloatImage, row: int, col: int, way: Cells) -> int:
    """Find the cheapest way by Dijkstra's algorithm, from the cells where it may end back to a start.

    Args:
        price: Price of each cell per side of a cell, above 0.
        left: Price that is left to pay from each cell where a way may end; +inf elsewhere.
        row: Row of the start.
        col: Column of the start.
        way: Receives the index of each cell of the way, from the start on.

    Returns:
        Number of cells of the way.
    """
    cost, towards = left.copy().ravel(), np.full(price.size, -1, np.int64)
    keys, items, n = np.empty(9 * price.size), np.empty(9 * price.size, np.int64), 0
    for cell in range(price.size):
        if cost[cell] < np.inf:
            n = push(keys, items, n, float(cost[cell]), cell)
    start = row * price.shape[1] + col
    while n > 0 and items[0] != start:
        paid, cell = keys[0], items[0]
        n = pop(keys, items, n)
        if paid <= cost[cell]:
            n = spread(price, paid, cell, cost, towards, keys, items, n)
    length, cell = 0, start
    while cell >= 0:
        way[length] = cell
        length, cell = length + 1, towards[cell]
    return length


@compiled(int64(uint8[:, ::1], int64, int64, int64, int64))
def worst_between(state: Bytes, row: int, col: int, to_row: int, to_col: int) -> int:
    """Return the worst state of the cells on the straight line between two cells."""
    n = 2 * max(abs(to_row - row), abs(to_col - col))
    worst = state[row, col]
    for k in range(1, n + 1):
        a, b = int(np.floor(row + (to_row - row) * k / n + 0.5)), int(np.floor(col + (to_col - col) * k / n + 0.5))
        worst = max(worst, state[a, b])
    return int(worst)

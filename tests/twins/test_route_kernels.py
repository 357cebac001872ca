"""The cheapest way costs what another implementation of Dijkstra's algorithm pays."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from swarm.route_kernels import cheapest_way
from voxdepth.types import FloatImage


def graph(price: FloatImage) -> coo_array:
    """Edges between neighbouring cells, diagonals included; their length is the mean price times the distance."""
    rows, cols = price.shape
    index = np.arange(price.size).reshape(price.shape)
    edges = []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, rows - down), slice(max(0, -right), cols - max(0, right)))
        there = (slice(down, rows), slice(max(0, right), cols + min(0, right)))
        length = np.hypot(down, right) * (price[here] + price[there]) / 2
        edges.append((index[here].ravel(), index[there].ravel(), length.ravel()))
    a, b, length = (np.concatenate(parts) for parts in zip(*edges, strict=True))
    return coo_array((np.tile(length, 2), (np.r_[a, b], np.r_[b, a])), shape=(price.size, price.size)).tocsr()


@pytest.mark.parametrize("seed", range(8))
def test_cheapest_way(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape = tuple(rng.integers(2, 15, 2).tolist())
    price = rng.choice(np.array([1, 2.5, 12, 30], np.float32), shape)
    left = np.full(shape, np.inf, np.float32)
    ends = rng.choice(price.size, min(3, price.size), replace=False)
    left.flat[ends] = rng.uniform(0, 5, len(ends))
    row, col = (int(rng.integers(n)) for n in shape)
    way = np.empty(price.size, np.int64)
    way = way[: cheapest_way(price, left, row, col, way)]
    edges = graph(price)
    paid = sum(edges[a, b] for a, b in pairwise(way.tolist())) + left.flat[way[-1]]
    least = (dijkstra(edges, indices=row * shape[1] + col) + left.ravel()).min()
    assert way[0] == row * shape[1] + col
    assert paid == pytest.approx(least, rel=1e-5)

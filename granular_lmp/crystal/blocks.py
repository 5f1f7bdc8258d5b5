"""Large arrays by blocks: what is computed on the way takes a few MB, in the cache of a processor, at any size."""

from collections.abc import Iterator

BLOCK = 1 << 15  # elements; good values: 1e4 to 1e5, with a dozen arrays of them in the cache


def blocks(count: int) -> Iterator[slice]:
    """Yield slices that cover `count` elements, each of at most `BLOCK`."""
    for start in range(0, count, BLOCK):
        yield slice(start, min(start + BLOCK, count))

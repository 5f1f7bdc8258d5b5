"""Large arrays in blocks, so that intermediate arrays take only a few MB and stay in the processor cache."""

from collections.abc import Iterator

BLOCK = 1 << 15  # elements; good values: 1e4 to 1e5, so that the cache holds a dozen blocks


def blocks(count: int) -> Iterator[slice]:
    """Yield slices that cover `count` elements, each of at most `BLOCK`."""
    for start in range(0, count, BLOCK):
        yield slice(start, min(start + BLOCK, count))

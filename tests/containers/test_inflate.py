"""Gzip is decompressed up to a limit, whole or not at all."""

import gzip

import numpy as np
import pytest

from bella.containers import inflate


def test_a_compressed_bomb_is_not_blown_up() -> None:
    with pytest.raises(ValueError, match="holds more than 1000 bytes"):
        inflate(gzip.compress(bytes(10**7)), 1000)


def test_what_is_inflated_in_pieces_is_whole() -> None:
    content = np.random.default_rng(3).bytes(200_001)
    packed = gzip.compress(content)

    assert inflate(packed, len(content)) == content
    assert inflate(packed + b"more", len(content)) == content
    for piece, reason in ((packed[:-1], "cut short"), (packed[:70_000], "cut short")):
        with pytest.raises(ValueError, match=reason):
            inflate(piece, len(content))
    with pytest.raises(ValueError, match="holds more than 200000 bytes"):
        inflate(packed, len(content) - 1)

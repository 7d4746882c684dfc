"""Random damage to files: whatever happens to the bytes, a file is read or refused, and soon.

``BELLA_MUTATIONS`` is the number of damaged files to try; without it the test takes a second or two. One kind of file,
with a seed of one's own, is tried by ``python -m tests.fuzz KIND NUMBER SEED``.
"""

import os
import resource
import time
from pathlib import Path

import numpy as np
import pytest

from tests.fuzz.damage import attempt, damaged_copies
from tests.fuzz.kinds import KINDS

BUDGET_S, SECONDS, GROWTH_KIB = 1.0, 10.0, 600 << 10
"""SECONDS are of the processor: what hangs takes for ever, what is refused takes milliseconds."""


@pytest.mark.usefixtures("reference_files")
def test_random_damage_is_read_or_refused(tmp_path: Path) -> None:
    wanted = int(os.environ.get("BELLA_MUTATIONS", "0"))
    random = np.random.default_rng(20100117)
    sources = []
    for name, kind in KINDS.items():
        folder = tmp_path / name
        folder.mkdir()
        sources.append((kind.read, damaged_copies(kind.example(tmp_path), folder, random)))
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    end, tried, slowest_s = time.monotonic() + BUDGET_S, 0, 0.0
    while tried < wanted if wanted else tried < len(sources) or time.monotonic() < end:
        read, copies = sources[tried % len(sources)]
        copy = next(copies)
        outcome = attempt(copy, read)
        assert outcome.read or (copy.stem in outcome.message and "\n" not in outcome.message)
        slowest_s = max(slowest_s, outcome.seconds)
        tried += 1

    assert slowest_s < SECONDS
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib < GROWTH_KIB

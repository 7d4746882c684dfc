"""Read many damaged files of one kind: ``python -m tests.fuzz KIND NUMBER SEED``, a line of JSON as the answer.

Other exceptions than those of bad input are written down with the file, which is kept, and do not stop it.
"""

import json
import resource
import shutil
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np

from bella.containers import READER
from tests.fuzz.damage import attempt, damaged_copies
from tests.fuzz.kinds import KINDS

LIMIT_S = 1.5
"""Of the processor, for a file of a few kilobytes and the imports of its library; the readers give it more."""


def main(kind: str, number: int, seed: int, kept: Path) -> dict[str, object]:
    ask = READER.ask
    READER.ask = lambda do, *of, cpu_s=LIMIT_S: ask(do, *of, cpu_s=min(cpu_s, LIMIT_S))  # type: ignore[method-assign]
    found: Counter[str] = Counter()
    slowest_s, begin = 0.0, time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        original = KINDS[kind].example(Path(folder))
        (Path(folder) / "damaged").mkdir()
        copies = damaged_copies(original, Path(folder) / "damaged", np.random.default_rng(seed))
        before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for tried in range(number):
            copy = next(copies)
            try:
                outcome = attempt(copy, KINDS[kind].read)
            except Exception as error:  # noqa: BLE001 - each is a finding
                found[f"{type(error).__name__}: {str(error)[:80]}"] += 1
                place = kept / f"{kind}-{seed}-{tried}-{copy.name}"
                (shutil.copytree if copy.is_dir() else shutil.copyfile)(copy, place)
                continue
            found["read" if outcome.read else "hangs" if "hangs or crashes" in outcome.message else "refused"] += 1
            slowest_s = max(slowest_s, outcome.seconds)
    READER.stop()
    growth_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib
    return {
        "kind": kind,
        "number": number,
        "seed": seed,
        **found,
        "slowest_s": round(slowest_s, 2),
        "growth_mib": growth_kib >> 10,
        "reader_mib": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss >> 10,
        "wall_s": round(time.monotonic() - begin),
    }


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    kind, number, seed = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
    kept = Path(tempfile.gettempdir()) / "bella-damaged"
    kept.mkdir(exist_ok=True)
    sys.stdout.write(json.dumps(main(kind, number, seed, kept)) + "\n")

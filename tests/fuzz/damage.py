"""Damaging files, and telling how a reader takes it."""

import shutil
import time
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bella.exceptions import InputError, NoDataError
from bella.spectra import open_spectra, validate_spectrum


@dataclass(frozen=True)
class Outcome:
    """What became of reading a file: read or refused, after how much work of the processor and with how much memory."""

    read: bool
    seconds: float
    peak_bytes: int
    message: str


def read_spectra(path: Path) -> None:
    for spectrum in open_spectra(path):
        validate_spectrum(spectrum, path.name)


def attempt(path: Path, read: Callable[[Path], object] = read_spectra, *, memory: bool = False) -> Outcome:
    """Read a file that may be damaged; any error but that of a bad or empty input is a failure of the test."""
    if memory:
        tracemalloc.start()
    begin = time.process_time()
    try:
        read(path)
        message = ""
    except (InputError, NoDataError) as error:
        message = str(error)
    seconds = time.process_time() - begin
    peak = tracemalloc.get_traced_memory()[1] if memory else 0
    tracemalloc.stop()
    return Outcome(not message, seconds, peak, message)


def mutations(content: bytes, random: np.random.Generator) -> Iterator[bytes]:
    """Damaged versions of a file without end: bytes changed, anywhere or where the structure is, or cut short."""
    structure = structural(content)
    while True:
        damaged = bytearray(content)
        for _ in range(int(random.integers(1, 9))):
            anywhere = random.random() < 0.2
            place = int(random.integers(len(content))) if anywhere else int(random.choice(structure))
            value = random.choice([0, 1, 127, 128, 255, int(random.integers(256))])
            damaged[place] = int(value)
        if random.random() < 0.1:
            del damaged[int(random.integers(len(damaged))) :]
        yield bytes(damaged)


def damaged_copies(original: Path, folder: Path, random: np.random.Generator) -> Iterator[Path]:
    """Damaged versions of a file, or of a store of which one file is damaged, each in place of the last."""
    copy = folder / original.name
    if original.is_file():
        for content in mutations(original.read_bytes(), random):
            copy.write_bytes(content)
            yield copy
    files = sorted(path for path in original.rglob("*") if path.is_file())
    contents = [path.read_bytes() for path in files]
    versions = [mutations(content, random) for content in contents]
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(original, copy)
    while True:
        chosen = int(random.integers(len(files)))
        place, content = copy / files[chosen].relative_to(original), contents[chosen]
        is_described = place.suffix == ".json" or place.name.startswith(".z")
        is_number = is_described and random.random() < 0.5
        place.write_bytes(with_another_number(content, random) if is_number else next(versions[chosen]))
        yield copy
        place.write_bytes(content)


def with_another_number(content: bytes, random: np.random.Generator) -> bytes:
    """A description in which a digit became a number of up to twelve more."""
    places = [place for place, byte in enumerate(content) if byte in b"0123456789"]
    if not places:
        return content
    chosen = places[int(random.integers(len(places)))]
    return content[:chosen] + str(10 ** int(random.integers(13))).encode() + content[chosen + 1 :]


def structural(content: bytes) -> np.ndarray:
    """Places where a change of a byte is likely to matter: the first KiB, and 64 bytes where a record may begin.

    Internal records of a CDF begin with a length of eight bytes of which the first five are zero.
    """
    array = np.frombuffer(content, dtype=np.uint8)
    zero = np.convolve((array == 0).astype(int), np.ones(5, dtype=int), "valid") == 5
    begin = np.flatnonzero(zero[:-16] & (array[: zero.size - 16] == 0))
    begin = begin[:4000]
    places = (begin[:, None] + np.arange(64)).ravel()
    return np.unique(np.concatenate([np.arange(min(1024, array.size)), places[places < array.size]]))

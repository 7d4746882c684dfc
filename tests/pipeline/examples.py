"""Inputs of a day and a run, made by hand."""

import hashlib
from collections.abc import Sequence
from datetime import date
from functools import cache
from pathlib import Path
from typing import Any

import xarray as xr

from bella.bursts import EVENT
from bella.catalogue import Series, SourceFile
from bella.pipeline.day_files import DayFiles
from bella.pipeline.inputs import BurstInput, load_burst
from bella.pipeline.surroundings import Surroundings
from bella.pipeline.tracks import Fitted, Timing, companions, fitted_track
from bella.settings import Settings


def files_of(day: date, paths: Sequence[Path]) -> DayFiles:
    """Files of a day as the mirror names them."""
    sums = [hashlib.sha256(path.read_bytes()).hexdigest() for path in paths]
    sources = tuple(SourceFile("any", day, "1", one, "done", path.name) for one, path in zip(sums, paths, strict=True))
    return DayFiles(day, tuple(paths), sources, hashlib.sha256("".join(sorted(sums)).encode()).hexdigest())


@cache
def built_in_event() -> BurstInput:
    """The built-in event as a run takes it, timed once."""
    return load_burst(EVENT.name, Path("nowhere"))


def whole_track(
    posterior: xr.Dataset, timing: Timing, series: Series, settings: Settings, around: Surroundings
) -> tuple[dict[str, Any], Fitted]:
    """Track of a solution as it is in the end, and its fits."""
    fitted = fitted_track(posterior, timing, series, settings)
    beside = companions(fitted, timing, settings.seed, around)
    return fitted.track.model_dump(mode="json") | {"companions": beside, "companions_pending": False}, fitted

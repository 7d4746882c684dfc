"""The figures on the page of a burst: those of an answer as it is first shown are drawn once, when it is published."""

import hashlib
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import structlog
import xarray as xr

from bella import __version__
from bella.catalogue import Burst, Solution
from bella.exceptions import InputError, NoDataError
from bella.plotting import (
    MapView,
    SpectraView,
    TrackView,
    constellation_figure,
    edge_name,
    evolution_figure,
    residual_figure,
    spectra_figure,
)
from bella.plotting.export import whole_file
from bella.records import Interval, Record
from bella.settings import Settings
from bella.spacecraft import position
from bella.units import FloatArray

log = structlog.get_logger(__name__)

DIGITS = 7
"""Significant digits of the numbers of a posterior in JSON."""


@dataclass(frozen=True)
class AnswerData:
    """An answer about a burst, with its posterior and its track fit as the catalogue keeps it."""

    solution: Solution
    posterior: xr.Dataset
    track: Mapping[str, Any]

    @property
    def has_positions(self) -> bool:
        """Whether its posterior holds sources; not so of a preliminary track."""
        return "region68" in self.posterior and "x_rsun" in self.posterior


class PosteriorSummary(Record):
    """Numbers of a posterior at each frequency."""

    draws: int
    units: dict[str, str]
    summary: dict[str, list[Any]]
    attributes: dict[str, Any]


class FirstLook(Record):
    """What the page of a burst shows of one answer at first, and the summary of its posterior."""

    figures: dict[str, str]
    channels_mhz: list[float]
    posterior: PosteriorSummary


def constellation(burst: Burst, answers: Sequence[AnswerData], look: MapView) -> str:
    """Map with the tracks of answers; where the first has no positions, with its sectors and the receivers."""
    tracks = [
        TrackView(edge_name(one.solution.series.edge), one.posterior, one.track) for one in answers if one.has_positions
    ]
    utc = np.datetime64(burst.start_utc.replace(tzinfo=None), "ns")
    if not answers or not answers[0].has_positions:
        sectors = (answers[0].track.get("joint") or {}).get("phi0_68", ()) if answers else ()
        receivers = places_of(burst.observatories, utc)
        look = replace(look, sectors=[Interval(**one) for one in sectors], receivers=receivers)
    return constellation_figure(tracks, utc, look)


def spectra(tree: xr.DataTree, answers: Sequence[AnswerData], look: SpectraView) -> str:
    """Spectra with the edges from which answers were made; a preliminary track keeps none."""
    edges = {one.solution.series.edge: one.posterior for one in reversed(answers) if one.has_positions}
    return spectra_figure(tree, edges, look)


def evolution(answer: AnswerData) -> str | None:
    """Distance and beam speed against frequency; None where there are no positions."""
    return evolution_figure(answer.posterior, answer.track) if answer.has_positions else None


def residuals(answer: AnswerData) -> str | None:
    """Residuals of the arrival times; None where they are not known."""
    is_known = answer.has_positions and "residual_s" in answer.posterior
    return residual_figure(answer.posterior) if is_known else None


def channels_of(answer: AnswerData) -> list[float]:
    """Frequencies with a source, MHz, ascending."""
    return sorted(map(float, answer.posterior["frequency"].to_numpy())) if answer.has_positions else []


def first_look(burst: Burst, answer: AnswerData, tree: xr.DataTree | None) -> FirstLook:
    """Draw what the page of a burst shows of an answer at first.

    Parameters
    ----------
    tree : xarray.DataTree or None
        Spectra; None where none were kept.

    Returns
    -------
    FirstLook
        Without the figures that it has none of.
    """
    drawn = {
        "constellation": constellation(burst, [answer], MapView()),
        "spectra": None if tree is None else spectra(tree, [answer], SpectraView()),
        "evolution": evolution(answer),
        "residuals": residuals(answer),
    }
    figures = {name: one for name, one in drawn.items() if one is not None}
    return FirstLook(figures=figures, channels_mhz=channels_of(answer), posterior=summary_of(answer.posterior))


def summary_of(group: xr.Dataset) -> PosteriorSummary:
    """Numbers of a posterior at each frequency; None where there is no number."""
    numbers = [str(name) for name, variable in group.variables.items() if variable.dims == ("frequency",)]
    return PosteriorSummary(
        draws=group.sizes.get("draw", 0),
        units={_public(name): str(group[name].attrs.get("units", "")) for name in numbers},
        summary={_public(name): _column(group.variables[name].to_numpy()) for name in numbers},
        attributes={str(name): _plain(value) for name, value in group.attrs.items()},
    )


def first_look_path(burst: Burst, solution: Solution, settings: Settings) -> Path:
    """File of a first look; its name changes with all that it is drawn from, except for methods beside a track."""
    begin = f"{burst.start_utc:%Y-%m-%dT%H:%M:%S}"
    parts = (__version__, solution.store_sha256, str(burst.spectra_path), begin, *burst.observatories)
    drawn_from = hashlib.sha256("|".join(parts).encode()).hexdigest()[:16]
    return settings.first_look(burst.burst_id, solution.solution_id, drawn_from)


def keep_first_look(path: Path, look: FirstLook) -> None:
    """Write a first look in place of earlier ones, those of other versions of its series too.

    Raises
    ------
    OSError
        If the disk refuses.
    """
    with whole_file(path) as part:
        part.write_bytes(zlib.compress(look.model_dump_json().encode(), 9))
    series = path.stem.rpartition(".v")[0]
    for other in path.parent.glob(f"{series}.v*{path.suffix}"):
        if other != path:
            other.unlink(missing_ok=True)


def kept_first_look(path: Path) -> FirstLook | None:
    """First look that was kept; None where there is none, or it is damaged."""
    try:
        return FirstLook.model_validate_json(zlib.decompress(path.read_bytes()))
    except FileNotFoundError:
        return None
    except (OSError, ValueError, zlib.error) as error:
        log.warning("figures of a page cannot be read", path=str(path), reason=str(error).partition("\n")[0])
        return None


@lru_cache(maxsize=10_000)
def places_of(names: tuple[str, ...], utc: np.datetime64) -> Mapping[str, FloatArray]:
    """Where those spacecraft were whose positions are known, HEE."""
    found = {}
    for name in names:
        try:
            found[name] = position(name, utc)[0]
        except (InputError, NoDataError):
            continue
    return found


def _public(name: str) -> str:
    return "frequency_mhz" if name == "frequency" else name


def _column(values: Any) -> list[Any]:
    if values.dtype.kind != "f":
        return list(values.tolist())
    return [float(f"{one:.{DIGITS}g}") if math.isfinite(one) else None for one in values.tolist()]


def _plain(value: Any) -> Any:
    return value.item() if hasattr(value, "item") and getattr(value, "ndim", 1) == 0 else value

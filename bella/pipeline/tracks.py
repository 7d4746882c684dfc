"""Track of a solution: joint and two-step fit, wave directions, and the companions beside the fits."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import structlog
import xarray as xr

from bella.arrivals import ArrivalGrid, arrival_grid
from bella.catalogue import Series, SourceFile
from bella.exceptions import BellaError, ConvergenceError, GeometryError, InputError, NoDataError
from bella.flags import NOT_COMPUTED
from bella.multilateration.priors import apply_sigma_rule, find_preset
from bella.pipeline.surroundings import Surroundings, footpoint_of, wind_of
from bella.records import MeasuredWind, Track
from bella.settings import Settings
from bella.spectra import power_above_background
from bella.tracks import TrackFit, WindPrior, fit_track, measured_wind, track_record, with_joint_draws
from bella.tracks.compare import fused_companion, models_companion
from bella.tracks.directions import DirectionTerms, direction_terms, wave_directions
from bella.tracks.fit import FEWEST_DRAWS
from bella.tracks.model import TrackModel
from bella.tracks.scattering import apparent_over_true, density_companion, scattering_companion
from bella.tracks.semp import semp_companion
from bella.tracks.spiral import piecewise_fit, track_fit
from bella.tracks.triangulation import FLOOR_DEG, triangulation_companion

log = structlog.get_logger(__name__)

Window = tuple[np.datetime64, np.datetime64]

TRACK_RECIPE = {
    "model": TrackModel().name,
    "directions": f"turned by {FLOOR_DEG:g} deg, each spacecraft's alike",
    "companions": [
        "semp",
        "piecewise",
        "density_excess",
        "scattering",
        "footpoint",
        "wind",
        "triangulation",
        "fused",
        "models",
    ],
}
"""Choices that decide the track of a solution; another one makes a new version."""


@dataclass(frozen=True)
class Timing:
    """Arrival times of a burst with one definition of the edge.

    Attributes
    ----------
    arrivals : DataFrame
        Located arrival table that the positions come from.
    channels : DataFrame or None
        Located arrival table of the channels themselves, for the joint fit; None: it is made from `arrivals`.
    directions : DataFrame or None
        Wave directions of the burst, where its spectra carry them.
    compared : bool
        Whether models with laws are weighed beside the track: done for one edge of a burst.
    sources : tuple of SourceFile
        Files that the times were measured in; none where the times were given.
    """

    arrivals: pd.DataFrame
    channels: pd.DataFrame | None = None
    directions: pd.DataFrame | None = None
    compared: bool = True
    sources: tuple[SourceFile, ...] = ()


@dataclass(frozen=True)
class Fitted:
    """Joint and two-step fit of a solution: all that its answer, its grade and its flags rest on.

    Attributes
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    grid : ArrivalGrid
        Arrival times as the joint fit took them.
    track : Track
        Without companions.
    """

    posterior: xr.Dataset
    grid: ArrivalGrid
    fit: TrackFit
    track: Track

    @property
    def drawn(self) -> xr.Dataset:
        """Posterior with the draws of the joint fit."""
        return with_joint_draws(self.posterior, self.fit)


def fitted_track(posterior: xr.Dataset, timing: Timing, series: Series, settings: Settings) -> Fitted:
    """Fit the track of a solution, jointly and in two steps.

    Parameters
    ----------
    posterior : xarray.Dataset
        A solution of :func:`bella.multilateration.localise`.
    """
    table = timing.arrivals if timing.channels is None else timing.channels
    preset = find_preset(series.preset)
    grid = apply_sigma_rule(arrival_grid(table, received_by=1), preset)
    line = track_fit(posterior)
    model = TrackModel(rotation_period_d=line["rotation_period_d"], delay=preset.delay)
    fit = fit_track(grid, model, draws=max(settings.draws, FEWEST_DRAWS), seed=settings.seed)
    track = track_record(fit, line, {}).model_copy(update={"companions_pending": True})
    return Fitted(posterior, grid, fit, track)


def companions(fitted: Fitted, timing: Timing, seed: int, around: Surroundings) -> dict[str, Any]:
    """Everything that stands beside the fits of a track; what cannot be computed says why, and stops nothing.

    It takes several times as long as the fits, so a solution is published before it.

    Parameters
    ----------
    around : Surroundings
        Wind and Sun around the burst.

    Returns
    -------
    dict
        Ready for JSON.
    """
    posterior, grid, fit = fitted.posterior, fitted.grid, fitted.fit
    spirals = attempted(lambda: piecewise_fit(posterior))
    density = attempted(lambda: density_companion(posterior))
    scattering = attempted(lambda: scattering_companion(posterior, fit))
    wind = attempted(lambda: wind_of(posterior, fit.record.model_dump(mode="json"), scattering, around))
    terms = directed(timing.directions, timing.arrivals, grid.reference_utc)
    return {
        "semp": attempted(lambda: semp_companion(grid)),
        "weighted": spirals.get("weighted", spirals),
        "piecewise": spirals.get("piecewise", spirals),
        "density_excess": density,
        "scattering": scattering,
        "footpoint": attempted(lambda: footpoint_of(fit, grid.observatories, around)),
        "wind": wind,
        **({"models": attempted(lambda: models_companion(fit, grid, seed))} if timing.compared else {}),
        "triangulation": attempted(lambda: triangulation_companion(terms)),
        "fused": attempted(lambda: fused_companion(fit, grid, terms, known_wind(wind, fit.track.band_mhz), seed)),
    }


def attempted(compute: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Result, or a flag and the reason why there is none."""
    try:
        return compute()
    except (ConvergenceError, GeometryError, InputError, NoDataError) as error:
        return {"flags": [NOT_COMPUTED], "reason": str(error)}


def burst_directions(spectra: Iterable[xr.Dataset], window: Window, band_mhz: tuple[float, float]) -> pd.DataFrame:
    """Wave directions of a burst from the spectra that carry them.

    Parameters
    ----------
    spectra : iterable of xarray.Dataset
        Over their background.
    window : tuple of numpy.datetime64
        When the burst was received.
    band_mhz : tuple of float
        Lowest and highest frequency of the burst.

    Returns
    -------
    pandas.DataFrame
        As :func:`bella.tracks.directions` returns it; of no rows where no spectrum carries directions.
    """
    parts = [pd.DataFrame()]
    for spectrum in spectra:
        if not any(str(name).startswith("wave_azimuth") for name in spectrum):
            continue
        linear = spectrum.assign(intensity=power_above_background(spectrum))
        try:
            found = wave_directions(linear.sel(frequency=slice(*band_mhz)), window)
        except BellaError as error:
            log.warning("no wave directions", observatory=spectrum.attrs["observatory"], reason=str(error))
            continue
        if found.attrs["turned"]:
            log.info("wave vectors turned towards their source", observatory=spectrum.attrs["observatory"])
        parts.append(found)
    return pd.concat(parts, ignore_index=True)


def directed(directions: pd.DataFrame | None, arrivals: pd.DataFrame, epoch: np.datetime64) -> DirectionTerms | None:
    """Wave directions as a likelihood takes them.

    Parameters
    ----------
    directions : pandas.DataFrame or None
        As :func:`burst_directions` returns it.
    arrivals : pandas.DataFrame
        Located arrival table, for where the spacecraft were.
    epoch : numpy.datetime64
        Of the HEE axes.

    Returns
    -------
    DirectionTerms or None
        None where there are no directions.
    """
    if directions is None or not len(directions):
        return None
    return direction_terms(directions.assign(x_rsun=np.nan, y_rsun=np.nan, z_rsun=np.nan), arrivals, epoch, FLOOR_DEG)


def known_wind(wind: Mapping[str, Any], band_mhz: tuple[float, float]) -> WindPrior | None:
    """Prior of the apparent spiral from a wind measured in situ.

    Parameters
    ----------
    wind : mapping
        Companion of that name; its ``measured`` is the wind of the true spiral, fundamental and harmonic.
    band_mhz : tuple of float
        Lowest and highest frequency of the burst.

    Returns
    -------
    WindPrior or None
        None where nothing was measured.
    """
    measured = [MeasuredWind(**one) for one in wind.get("measured", {}).values()]
    if not measured:
        return None
    speed, sd = np.mean([one.to(one.range_rsun[-1]) for one in measured], axis=0)
    return measured_wind(float(speed), float(sd), *apparent_over_true(band_mhz))

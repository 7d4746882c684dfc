"""Observability: how well a fleet locates a source in each direction, on a day with spectra or before any."""

from collections.abc import Sequence
from datetime import date

import numpy as np
import structlog
import xarray as xr

from bella.arrivals import MIN_OBSERVATORIES
from bella.catalogue import FleetMap, ObservedDay, ReceiverDay
from bella.catalogue.operation import BINS, MINUTES_PER_BIN, fleet_of
from bella.exceptions import BellaError, InputError, NoDataError
from bella.heliosphere import DENSITY_MODELS, emission_range_rsun
from bella.multilateration.posterior import Recipe, exact_posterior
from bella.multilateration.priors import find_preset
from bella.multilateration.uncertainty_map import Receivers, noise_free_arrivals
from bella.records import Prediction
from bella.spacecraft import position_hee

log = structlog.get_logger(__name__)

DISTANCES_RSUN = (20.0, 50.0, 100.0)
"""About where the plasma frequency is 1, 0.4 and 0.2 MHz."""
LONGITUDES_DEG = tuple(float(longitude) for longitude in range(-180, 180, 10))
PLANNED_RSUN = (10.0, 20.0, 35.0, 50.0, 75.0, 100.0, 150.0)
PLANNED_LONGITUDES_DEG = tuple(float(longitude) for longitude in range(-180, 180, 15))
"""Of a fleet before there are data: what is computed while somebody waits has fewer directions."""

DENSITY, HARMONIC = "leblanc", 2
PRESET = "default"

FEWEST_DRAWS = 16
"""The size of a region is computed without draws."""

LEAST_SIGMA_S, MOST_SIGMA_S = 1.0, 600.0
"""Bounds of a timing error that is taken from a cadence, s."""


def observed_day(day: date, spectra: Sequence[xr.Dataset]) -> ObservedDay:
    """Observability of a day.

    Parameters
    ----------
    spectra : sequence of xarray.Dataset
        Dynamic spectra of the day, one for each spacecraft.

    Returns
    -------
    ObservedDay
        With a map for every set of three or more receivers that had data together in some hour.
    """
    named = {str(one.attrs["observatory"]): one for one in spectra}
    receivers = tuple(ReceiverDay(observatory=name, fraction=_fraction(day, named[name])) for name in sorted(named))
    fleets = {fleet_of(receivers, hour): None for hour in range(BINS)}
    sigma_s = {name: _cadence_s(one) for name, one in named.items()}
    large = [fleet for fleet in fleets if len(fleet) >= MIN_OBSERVATORIES]
    maps = [found for fleet in large if (found := fleet_map(day, fleet, sigma_s)) is not None]
    return ObservedDay(
        day=day,
        distances_rsun=DISTANCES_RSUN,
        longitudes_deg=LONGITUDES_DEG,
        receivers=receivers,
        maps=tuple(maps),
    )


def _fraction(day: date, spectrum: xr.Dataset) -> tuple[float, ...]:
    """Part of each hour that is covered by records with a value."""
    has_value = np.isfinite(spectrum["intensity"].to_numpy()).any(axis=spectrum["intensity"].get_axis_num("frequency"))
    minutes = (spectrum["time"].to_numpy() - np.datetime64(day, "ns")) / np.timedelta64(1, "m")
    edges = np.arange(BINS + 1) * float(MINUTES_PER_BIN)
    records, _ = np.histogram(minutes[has_value], edges)
    covered = records * _cadence_s(spectrum) / (60.0 * MINUTES_PER_BIN)
    return tuple(round(float(part), 3) for part in np.minimum(covered, 1.0))


def _cadence_s(spectrum: xr.Dataset) -> float:
    """Median step between records, s: about the timing error (Canizares et al. 2024, A&A 684, A40, Sect. 2)."""
    steps = np.diff(spectrum["time"].to_numpy()) / np.timedelta64(1, "s")
    return float(np.clip(np.median(steps), LEAST_SIGMA_S, MOST_SIGMA_S)) if steps.size else MOST_SIGMA_S


def fleet_map(day: date, fleet: tuple[str, ...], sigma_s: dict[str, float]) -> FleetMap | None:
    """Size of the 68 % region of a source in each direction, from the exact posterior of noise-free arrival times.

    Parameters
    ----------
    day : datetime.date
        Positions are those of its noon.
    fleet : tuple of str
        Three or more.
    sigma_s : dict of str to float
        Timing error of each, s.

    Returns
    -------
    FleetMap or None
        None where the position of one is not known.
    """
    noon = np.datetime64(day, "ns") + np.timedelta64(12, "h")
    try:
        where = np.array([position_hee(name, [noon], noon)[0] for name in fleet])
    except BellaError as error:
        log.warning("no observability", fleet=list(fleet), reason=str(error))
        return None
    receivers = Receivers(fleet, where, np.array([sigma_s[name] for name in fleet]))
    rows = tuple(region_radii(distance, LONGITUDES_DEG, receivers) for distance in DISTANCES_RSUN)
    return FleetMap(observatories=fleet, sigma_s={name: sigma_s[name] for name in fleet}, radius68_rsun=rows)


def region_radii(
    distance_rsun: float, longitudes_deg: Sequence[float], receivers: Receivers
) -> tuple[float | None, ...]:
    """Radius of the circle with the area of the 68 % region of a source at a distance, in each direction.

    The region may be several pieces, such as a source and its mirror image.

    Parameters
    ----------
    longitudes_deg : sequence of float
        HEE.
    receivers : Receivers
        Three or more.

    Returns
    -------
    tuple of float or None
        Solar radii; None where the posterior cannot be computed.
    """
    angle = np.radians(longitudes_deg)
    points = distance_rsun * np.column_stack([np.cos(angle), np.sin(angle)])
    recipe = Recipe("posterior", find_preset(PRESET), dimensions=2, draws=FEWEST_DRAWS, seed=0)
    try:
        posterior = exact_posterior(noise_free_arrivals(points, receivers), recipe, lambda _: None)
    except BellaError as error:
        log.warning("no observability at a distance", reason=str(error))
        return (None,) * len(points)
    radius = np.sqrt(np.array([one.area_rsun2[0] for one in posterior.regions]) / np.pi)
    return tuple(round(float(one), 2) if np.isfinite(one) else None for one in radius)


def predicted(day: date, fleet: tuple[str, ...], sigma_s: float, frequency_mhz: float) -> Prediction:
    """How well a source would be located, from the exact posterior of noise-free arrival times.

    Parameters
    ----------
    day : datetime.date
        Positions are those of its noon.
    sigma_s : float
        Timing error of each arrival time, s.
    frequency_mhz : float
        Whose distance is added to `PLANNED_RSUN`.

    Returns
    -------
    Prediction
        Without radii where fewer than three positions are known.

    Raises
    ------
    InputError
        If the density model emits the frequency nowhere.
    """
    noon = np.datetime64(day, "ns") + np.timedelta64(12, "h")
    where, missing = {}, {}
    for name in fleet:
        try:
            where[name] = position_hee(name, [noon], noon)[0]
        except (InputError, NoDataError) as error:
            missing[name] = str(error)
    reached = round(float(emission_range_rsun(np.array([frequency_mhz]), DENSITY_MODELS[DENSITY], HARMONIC)[0]), 1)
    is_enough = len(where) >= MIN_OBSERVATORIES
    distances = tuple(sorted({*PLANNED_RSUN, reached})) if is_enough else ()
    rows: list[tuple[float | None, ...]] = []
    if is_enough:
        receivers = Receivers(tuple(where), np.array(list(where.values())), np.full(len(where), sigma_s))
        rows = [region_radii(distance, PLANNED_LONGITUDES_DEG, receivers) for distance in distances]
    return Prediction(
        day=day,
        sigma_s=sigma_s,
        frequency_mhz=frequency_mhz,
        frequency_rsun=reached,
        receivers_rsun={name: tuple(float(round(one, 2)) for one in place) for name, place in where.items()},
        missing=missing,
        localisable=is_enough,
        distances_rsun=distances,
        longitudes_deg=PLANNED_LONGITUDES_DEG,
        radius68_rsun=tuple(rows),
    )

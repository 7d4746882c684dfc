"""Could a source be located: what a fleet on a day would tell of a source in each direction, before there are data."""

from datetime import date

import numpy as np

from bella.arrivals import MIN_OBSERVATORIES
from bella.exceptions import InputError, NoDataError
from bella.heliosphere import DENSITY_MODELS, emission_range_rsun
from bella.multilateration.uncertainty_map import Receivers
from bella.pipeline.observability import region_radii
from bella.records import Prediction
from bella.spacecraft import position_hee

DISTANCES_RSUN = (10.0, 20.0, 35.0, 50.0, 75.0, 100.0, 150.0)
LONGITUDES_DEG = tuple(float(longitude) for longitude in range(-180, 180, 15))
DENSITY, HARMONIC = "leblanc", 2


def predicted(day: date, fleet: tuple[str, ...], sigma_s: float, frequency_mhz: float) -> Prediction:
    """How well a source would be located, from the exact posterior of noise-free arrival times.

    Parameters
    ----------
    day : datetime.date
        Positions are those of its noon.
    sigma_s : float
        Timing error of each arrival time, s.
    frequency_mhz : float
        Whose distance is added to `DISTANCES_RSUN`.

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
    distances = tuple(sorted({*DISTANCES_RSUN, reached})) if is_enough else ()
    rows: list[tuple[float | None, ...]] = []
    if is_enough:
        receivers = Receivers(tuple(where), np.array(list(where.values())), np.full(len(where), sigma_s))
        rows = [region_radii(distance, LONGITUDES_DEG, receivers) for distance in distances]
    return Prediction(
        day=day,
        sigma_s=sigma_s,
        frequency_mhz=frequency_mhz,
        frequency_rsun=reached,
        receivers_rsun={name: tuple(float(round(one, 2)) for one in place) for name, place in where.items()},
        missing=missing,
        localisable=is_enough,
        distances_rsun=distances,
        longitudes_deg=LONGITUDES_DEG,
        radius68_rsun=tuple(rows),
    )

"""One spectrum for each spacecraft, from whatever files there are of it."""

from collections.abc import Iterable
from functools import reduce

import xarray as xr

from bella.exceptions import InputError
from bella.spectra.assembly import cadence_s
from bella.spectra.combination import combine_receivers, join_days

LEFT_OUT = {("WIND", "TNR")}
"""Receivers that look at the plasma around the spacecraft, below the band of bursts far from it."""


def by_observatory(spectra: Iterable[xr.Dataset]) -> dict[str, xr.Dataset]:
    """Join days and combine receivers of every spacecraft.

    Where there are several products of a spacecraft (of different quantities, which cannot be combined), the one of the
    finest cadence is taken; of equal ones, that with more channels.

    Parameters
    ----------
    spectra : iterable of xarray.Dataset
        Dynamic spectra of any spacecraft, receivers and days.

    Returns
    -------
    dict of str to xarray.Dataset
        By observatory, in the order in which they come first.

    Raises
    ------
    InputError
        If there are none.
    """
    products: dict[tuple[str, str], dict[str, list[xr.Dataset]]] = {}
    for spectrum in spectra:
        name, receiver = str(spectrum.attrs["observatory"]), str(spectrum.attrs["receiver"])
        if (name, receiver) not in LEFT_OUT:
            receivers = products.setdefault((name, str(spectrum.attrs["quantity"])), {})
            receivers.setdefault(receiver, []).append(spectrum)
    if not products:
        raise InputError("there are no spectra of radio bursts: name files of at least one receiver")
    combined = [
        (
            name,
            reduce(combine_receivers, [join_days(days) if len(days) > 1 else days[0] for days in receivers.values()]),
        )
        for (name, _), receivers in products.items()
    ]
    best: dict[str, xr.Dataset] = {}
    for name, spectrum in combined:
        if name not in best or _rank(spectrum) < _rank(best[name]):
            best[name] = spectrum
    return best


def _rank(spectrum: xr.Dataset) -> tuple[float, int]:
    return round(cadence_s(spectrum["time"].to_numpy()), 1), -spectrum.sizes["frequency"]

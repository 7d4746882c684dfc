"""Parker Solar Probe FIELDS/RFS CDFs: LFR and HFR, as voltage (L2) and as flux (L3)."""

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.containers import ANOTHER, CdfFile, TimeArray
from bella.exceptions import InputError
from bella.spectra.assembly import (
    Origin,
    ascending,
    assemble,
    cadence_s,
    check_clock,
    nearest_records,
    shared_channels,
    without_strays,
)
from bella.spectra.beside import Beside, epoch_of, read_records, timed
from bella.spectra.dynamic_spectrum import in_unit

OBSERVATORY = "PSP"
DIPOLES = ("ch0_V1V2", "ch1_V3V4")
HIGHEST_MHZ = {"lfr": 1.7, "hfr": 19.2}
SAME_RECORD = 0.25
"""Records of the two dipoles so near, as a share of the time between records, were read at the same time."""

SAME_CHANNEL = 1e-3
"""Their channels may differ by this: the step between channels is 45 times as large."""

LIKELY_SHARE = 3**-0.5
"""Time that a record averages over, as a share of the step to the next. It is not stated: any from none to the whole
step is as likely, and what counts for a light curve is the square, a third of that of the step.
"""


class Part(NamedTuple):
    """What one dipole recorded."""

    time: TimeArray
    """Ascending, shape (records,)."""
    frequency_mhz: npt.NDArray[Any]
    power: npt.NDArray[Any]
    """Shape (records, channels)."""
    offset_s: npt.NDArray[Any] | None = None
    """How long after the time of its record each sample was taken; of the same shape."""


def read_l2(cdf: CdfFile, receiver: str) -> tuple[xr.Dataset, ...]:
    """Mean power on the two dipoles, V^2/Hz, at native cadence (7 s in encounters, 56 s in cruise, mixed in a day).

    Not yet run on an archive file: written to the published description of the product. The dipoles V1-V2 and V3-V4
    are summed, which is Stokes I, where both were read at the same time; a record of one only counts twice. Where the
    file has only one dipole, it stands alone and the attribute ``dipoles`` says so.

    Parameters
    ----------
    receiver : str
        lfr or hfr.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``psd_v2_hz``, 64 channels.

    Raises
    ------
    InputError
        If the file is not of this product, or neither dipole was read.
    """
    return (_averaged(_sum_of_dipoles(cdf, receiver, "psp_fld_l2", "", "psd_v2_hz")),)


def read_l3(cdf: CdfFile, receiver: str) -> tuple[xr.Dataset, ...]:
    """Flux density at native cadence.

    Not yet run on an archive file: written to the published description of the product. ``PSD_FLUX`` is read where
    the file has it, else the fluxes of the two dipoles are summed as in L2.

    Parameters
    ----------
    receiver : str
        lfr or hfr.

    Returns
    -------
    tuple of xarray.Dataset
        One dynamic spectrum, quantity ``flux_w_m2_hz``, 64 channels.

    Raises
    ------
    InputError
        If the file is not of this product, or holds no flux.
    """
    fluxes = [f"psp_fld_l3_rfs_{receiver}_auto_averages_{dipole}_flux" for dipole in DIPOLES]
    whole = f"psp_fld_l3_rfs_{receiver}_PSD_FLUX"
    if cdf.first_with_records(whole, *fluxes) != whole:
        return (_averaged(_sum_of_dipoles(cdf, receiver, "psp_fld_l3", "_flux", "flux_w_m2_hz")),)
    suffix = f"{receiver}_auto_averages_{DIPOLES[0]}"
    frequency = cdf.first_with_data(cdf.attribute("DEPEND_1", whole), f"frequency_{suffix}")
    if not frequency:
        raise InputError(f"{cdf.name}: {whole} has no frequencies; {ANOTHER}")
    epoch = cdf.first_with_data(cdf.attribute("DEPEND_0", whole), f"epoch_{suffix}")
    time = cdf.utc(epoch or epoch_of(cdf, whole))
    flux = cdf.numbers(whole, 2)
    flux[flux <= 0.0] = np.nan
    origin = Origin(OBSERVATORY, receiver.upper(), "flux_w_m2_hz", cdf.name)
    channels_mhz = cdf.frequency_mhz(frequency, "Hz", HIGHEST_MHZ[receiver])
    return (_averaged(read_records(cdf, origin, whole, time, channels_mhz, flux)),)


def _averaged(spectrum: xr.Dataset) -> xr.Dataset:
    return spectrum.assign_attrs(integration_s=LIKELY_SHARE * spectrum.attrs["integration_s"])


def _sum_of_dipoles(cdf: CdfFile, receiver: str, prefix: str, ending: str, quantity: str) -> xr.Dataset:
    suffixes = {dipole: f"{receiver}_auto_averages_{dipole}" for dipole in DIPOLES}
    variables = {dipole: f"{prefix}_rfs_{suffix}{ending}" for dipole, suffix in suffixes.items()}
    held = [dipole for dipole, variable in variables.items() if cdf.has_records(variable)]
    with_data = [dipole for dipole in held if cdf.first_with_data(variables[dipole])]
    read = {}
    for dipole in with_data or held:
        names = (f"epoch_{suffixes[dipole]}", f"frequency_{suffixes[dipole]}", variables[dipole])
        read[dipole[4:]] = _part(cdf, *names, HIGHEST_MHZ[receiver])
        in_unit(read[dipole[4:]].power, cdf.attribute("UNITS", variables[dipole]), quantity)
    if not read:
        raise InputError(
            f"{cdf.name}: neither dipole has auto_averages; the receiver was in another mode; leave the file out"
        )
    parts = list(read.values())
    whole = parts[0] if len(parts) == 1 else _union(*parts)
    if whole is None:
        most = max(read, key=lambda name: np.count_nonzero(np.isfinite(read[name].power)))
        read, whole = {most: read[most]}, read[most]
    origin = Origin(OBSERVATORY, receiver.upper(), quantity, cdf.name)
    time, extra = whole.time, {}
    if whole.offset_s is not None:
        time, extra["sample_time"] = timed(time, whole.offset_s)
    return assemble(origin, time, whole.frequency_mhz, whole.power, extra).assign_attrs(dipoles="+".join(read))


def _part(cdf: CdfFile, epoch: str, frequency: str, variable: str, highest_mhz: float) -> Part:
    power, time = cdf.numbers(variable, 2), cdf.utc(cdf.first_with_data(epoch) or epoch_of(cdf, variable))
    power[power <= 0.0] = np.nan
    beside = Beside(cdf, power.shape, variable, DIPOLES)
    beside.clear(power)
    stated_mhz, offset_s = cdf.frequency_mhz(frequency, "Hz", highest_mhz), beside.offset_s(time)
    frequency_mhz, power = shared_channels(stated_mhz, power, cdf.name)
    if offset_s is not None:
        offset_s = shared_channels(stated_mhz, offset_s, cdf.name)[1]
    if power.shape != (time.size, frequency_mhz.size):
        raise InputError(
            f"{cdf.name}: {variable} has the shape {power.shape}, not {(time.size, frequency_mhz.size)}; {ANOTHER}"
        )
    check_clock(time, cdf.name)
    time = without_strays(time)
    order = ascending(time, lambda: np.isfinite(power).sum(axis=1))
    return Part(time[order], frequency_mhz, power[order], None if offset_s is None else offset_s[order])


def _union(first: Part, second: Part) -> Part | None:
    """Records of both dipoles: their sum where both were read, twice the one else; None where the channels differ.

    A record joins the nearest one of the other dipole within `SAME_RECORD` of the time between records.
    """
    if first.frequency_mhz.size != second.frequency_mhz.size or not np.allclose(
        first.frequency_mhz, second.frequency_mhz, rtol=SAME_CHANNEL, atol=0.0
    ):
        return None
    if first.time.size < second.time.size:
        first, second = second, first
    partner = nearest_records(first.time, second.time, SAME_RECORD * min(cadence_s(first.time), cadence_s(second.time)))
    alone = partner < 0
    other = np.full(first.power.shape, np.nan, dtype=first.power.dtype)
    other[partner[~alone]] = second.power[~alone]
    mine = np.concatenate([first.power, np.full((int(alone.sum()), other.shape[1]), np.nan, dtype=other.dtype)])
    its = np.concatenate([other, second.power[alone]])
    lacks_mine, lacks_its = (~np.isfinite(one).any(axis=1, keepdims=True) for one in (mine, its))
    total = np.where(lacks_its, 2.0 * mine, np.where(lacks_mine, 2.0 * its, mine + its))
    offset_s = None
    if first.offset_s is not None or second.offset_s is not None:
        each = [np.zeros(one.power.shape) if one.offset_s is None else one.offset_s for one in (first, second)]
        offset_s = np.concatenate([each[0], each[1][alone]])
    return Part(np.concatenate([first.time, second.time[alone]]), first.frequency_mhz, total, offset_s)

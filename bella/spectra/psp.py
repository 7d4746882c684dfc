"""Parker Solar Probe FIELDS/RFS CDFs: LFR and HFR, as voltage (L2) and as flux (L3)."""

from typing import Any

import numpy as np
import numpy.typing as npt
import xarray as xr

from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble, shared_channels
from bella.spectra.cdf import CdfFile, TimeArray

OBSERVATORY = "PSP"
DIPOLES = ("ch0_V1V2", "ch1_V3V4")
Part = tuple[TimeArray, npt.NDArray[Any], npt.NDArray[Any]]


def read_l2(cdf: CdfFile, receiver: str) -> tuple[xr.Dataset, ...]:
    """Mean power on the two dipoles, V^2/Hz, at native cadence (7 s in encounters, 56 s in cruise, mixed in a day).

    Not yet run on an archive file: written to the published description of the product. The dipoles V1-V2 and V3-V4
    are summed, which is Stokes I, where both were read at the same time; where the file has only one, it stands alone
    and the attribute ``dipoles`` says so.

    Parameters
    ----------
    cdf : CdfFile
        The open file.
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
    return (_sum_of_dipoles(cdf, receiver, "psp_fld_l2", "", "psd_v2_hz"),)


def read_l3(cdf: CdfFile, receiver: str) -> tuple[xr.Dataset, ...]:
    """Flux density at native cadence.

    Not yet run on an archive file: written to the published description of the product. ``PSD_FLUX`` is read where
    the file has it, else the fluxes of the two dipoles are summed as in L2.

    Parameters
    ----------
    cdf : CdfFile
        The open file.
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
    whole = f"psp_fld_l3_rfs_{receiver}_PSD_FLUX"
    if not cdf.has_records(whole):
        return (_sum_of_dipoles(cdf, receiver, "psp_fld_l3", "_flux", "flux_w_m2_hz"),)
    suffix = f"{receiver}_auto_averages_{DIPOLES[0]}"
    axes = [
        cdf.attribute(attribute, whole) or f"{name}_{suffix}"
        for attribute, name in (("DEPEND_0", "epoch"), ("DEPEND_1", "frequency"))
    ]
    time, frequency_mhz, flux = _part(cdf, axes[0], axes[1], whole)
    return (assemble(Origin(OBSERVATORY, receiver.upper(), "flux_w_m2_hz", cdf.name), time, frequency_mhz, flux),)


def _sum_of_dipoles(cdf: CdfFile, receiver: str, prefix: str, ending: str, quantity: str) -> xr.Dataset:
    read = {}
    for dipole in DIPOLES:
        suffix = f"{receiver}_auto_averages_{dipole}"
        variable = f"{prefix}_rfs_{suffix}{ending}"
        if cdf.has_records(variable):
            read[dipole[4:]] = _part(cdf, f"epoch_{suffix}", f"frequency_{suffix}", variable)
    if not read:
        raise InputError(f"{cdf.name}: neither dipole has auto_averages; the receiver was in another mode")
    time, frequency_mhz, power = _summed(list(read.values()), cdf.name)
    spectrum = assemble(Origin(OBSERVATORY, receiver.upper(), quantity, cdf.name), time, frequency_mhz, power)
    return spectrum.assign_attrs(dipoles="+".join(read))


def _part(cdf: CdfFile, epoch: str, frequency: str, variable: str) -> Part:
    stated_mhz = cdf.frequency_mhz(frequency, "Hz")
    frequency_mhz, values = shared_channels(stated_mhz, cdf.numbers(variable, 2), cdf.name)
    time = cdf.utc(epoch)
    if values.shape != (time.size, frequency_mhz.size):
        raise InputError(f"{cdf.name}: {variable} has the shape {values.shape}, not {(time.size, frequency_mhz.size)}")
    values[values <= 0.0] = np.nan
    return time, frequency_mhz, values


def _summed(parts: list[Part], source: str) -> Part:
    if len(parts) == 1:
        return parts[0]
    (time, frequency_mhz, power), (other_time, other_frequency_mhz, other) = parts
    if not np.array_equal(frequency_mhz, other_frequency_mhz):
        raise InputError(f"{source}: the dipoles were read at different frequencies")
    if np.array_equal(time, other_time):
        power += other
        return time, frequency_mhz, power
    both, mine, its = np.intersect1d(time, other_time, return_indices=True)
    return both, frequency_mhz, power[mine] + other[its]

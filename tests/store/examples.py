"""A small posterior and small spectra with everything that is awkward to keep, and groups that are opened by hand."""

import zipfile
from pathlib import Path

import numpy as np
import xarray as xr


def files_of(group: Path) -> dict[str, bytes]:
    """Files of a group, by their Zarr key."""
    with zipfile.ZipFile(group) as packed:
        return {name: packed.read(name) for name in packed.namelist()}


def repack(group: Path, files: dict[str, bytes]) -> None:
    """Give a group these files, with checksums that agree with them."""
    rewrite(group, b"")
    with zipfile.ZipFile(group, "w") as packed:
        for name, content in files.items():
            packed.writestr(name, content)


def rewrite(file: Path, content: bytes) -> None:
    """Write to a file that is read-only."""
    file.chmod(0o644)
    file.write_bytes(content)


def posterior(frequencies: int = 5, draws: int = 40, seed: int = 1) -> xr.Dataset:
    """Dataset with the dimensions, types and gaps of a posterior."""
    rng = np.random.default_rng(seed)
    region = rng.normal(size=(frequencies, 7, 2)).astype("float32")
    region[:, 3:] = np.nan
    modes = np.ones(frequencies, dtype="int16")
    modes[0] = 0
    return xr.Dataset(
        {
            "draws": (("frequency", "draw", "parameter"), rng.normal(size=(frequencies, draws, 4)).astype("float32")),
            "x_rsun": ("frequency", rng.normal(size=frequencies), {"units": "R_sun", "long_name": "position"}),
            "never_determined": ("frequency", np.full(frequencies, np.nan)),
            "zero": ("frequency", np.zeros(frequencies)),
            "modes": ("frequency", modes),
            "multimodal": ("frequency", modes > 0),
            "flags": ("frequency", np.array(["", "two_modes;speed_not_constrained", "", "Ω", ""][:frequencies])),
            "region95": (("frequency", "vertex", "axis"), region),
            "reference": ((), 2.5),
            "arrival": ("frequency", np.datetime64("2012-06-07T19:29:00.123456789", "ns") + np.arange(frequencies)),
        },
        coords={
            "frequency": ("frequency", np.geomspace(0.15, 2.0, frequencies), {"units": "MHz"}),
            "parameter": ["x_rsun", "y_rsun", "emission_s", "v_over_c"],
            "axis": ["x", "y"],
        },
        attrs={"Conventions": "CF-1.11", "format_version": 1, "seed": 20120607, "burst_id": "T3-20120607-1929"},
    )


def spectra() -> xr.DataTree:
    """Tree with one child per observatory."""
    rng = np.random.default_rng(2)
    times = np.datetime64("2012-06-07T19:00:00", "ns") + np.arange(30) * np.timedelta64(60_000_000_000, "ns")
    children = {}
    for name, channels in (("WIND", 8), ("STEREO-A", 6)):
        intensity = rng.normal(size=(30, channels)).astype("float32")
        intensity[4] = np.nan
        children[name] = xr.Dataset(
            {"intensity": (("time", "frequency"), intensity)},
            coords={"time": times, "frequency": np.geomspace(0.1, 10, channels)},
            attrs={"observatory": name, "quantity": "relative_flux"},
        )
    return xr.DataTree.from_dict({"/": xr.Dataset(attrs={"format_version": 1}), **children})

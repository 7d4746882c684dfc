"""The spectra of the burst of 2012-06-07, read off a published figure.

The figure belongs to the public notebook TDOA_OpenSource.ipynb (STBadman/Radio-Public, doi:10.5281/zenodo.10107890).
Its colour map can be inverted exactly, so the values are good to 1/255 and the times to 3 s. Each channel is divided by
its maximum between 19:25 and 20:30 UT. What Wind shows is a ratio of voltages, what STEREO shows a flux (the attribute
``power_exponent`` says so): only the square of Wind's values decays as fast as what STEREO shows.
"""

from importlib import resources

import numpy as np
import xarray as xr

from bella.spectra.dynamic_spectrum import validate_spectrum

RESOURCE = "event_2012-06-07.nc"


def event_spectra() -> xr.DataTree:
    """Spectra of the built-in event, as seen by Wind, STEREO-A and STEREO-B.

    Returns
    -------
    xarray.DataTree
        Children "WIND", "STEREO-A" and "STEREO-B", each a dynamic spectrum in memory, quantity ``relative_flux``.
    """
    with (
        resources.as_file(resources.files("bella.spectra") / RESOURCE) as path,
        xr.open_datatree(path, engine="h5netcdf") as stored,
    ):
        children = {name: child.to_dataset().load() for name, child in stored.children.items()}
        root = stored.to_dataset().load()
    spectra = {name: _spectrum(child, f"{RESOURCE}/{name}") for name, child in children.items()}
    return xr.DataTree.from_dict({"/": root, **spectra})


def _spectrum(stored: xr.Dataset, source: str) -> xr.Dataset:
    return validate_spectrum(stored.assign(intensity=stored["intensity"].astype(np.float32, keep_attrs=True)), source)

"""Files as such, whole or damaged, whatever they hold: gzip, times; CDF, HDF5 and Zarr by a process of their own."""

from bella.containers.bounded import ANOTHER, INFLATED_BYTES, READER, check_hdf5, inflate, reading
from bella.containers.cdf import (
    LARGEST_NUMBER,
    MAGIC,
    MHZ,
    CdfFile,
    NumberArray,
    TimeArray,
    in_mhz,
    open_cdf,
    utc_of_cdf_epoch,
    utc_of_cdf_epoch16,
    utc_of_tt2000,
)
from bella.containers.zarr_store import is_zarr, zarr_groups

__all__ = [
    "ANOTHER",
    "INFLATED_BYTES",
    "LARGEST_NUMBER",
    "MAGIC",
    "MHZ",
    "READER",
    "CdfFile",
    "NumberArray",
    "TimeArray",
    "check_hdf5",
    "in_mhz",
    "inflate",
    "is_zarr",
    "open_cdf",
    "reading",
    "utc_of_cdf_epoch",
    "utc_of_cdf_epoch16",
    "utc_of_tt2000",
    "zarr_groups",
]

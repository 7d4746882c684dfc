"""BELLA service: where was that radio burst, and how sure are we.

The functions below are what a notebook needs; each takes a pandas DataFrame, an astropy QTable or a file, and returns
an object with ``to_table()``, ``to_skycoord()``, ``plot()`` and ``posterior`` where these make sense:

- :func:`read_arrivals`, :func:`localise`, :func:`fit_track`: from arrival times to positions and to the spiral behind
- :func:`detect`, :func:`time_edges`: from spectra to bursts, and to arrival times
- :class:`bella.client.Client`: a running service

The rooms of this package hold the science and nothing of the service around it: importing any of them needs neither
Prefect nor FastAPI. Data flow one way: spectra, bursts, arrivals, localisations, track, record.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bella.analysis import (
        Arrivals,
        Detections,
        FittedTrack,
        Localisation,
        detect,
        fit_track,
        localise,
        read_arrivals,
        time_edges,
    )

__version__ = "0.2.0"

__all__ = [
    "Arrivals",
    "Detections",
    "FittedTrack",
    "Localisation",
    "__version__",
    "detect",
    "fit_track",
    "localise",
    "read_arrivals",
    "time_edges",
]


def __getattr__(name: str) -> Any:
    """Import what is asked for when it is first asked for: ``import bella`` alone stays light."""
    if name in __all__:
        return getattr(import_module("bella.analysis"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

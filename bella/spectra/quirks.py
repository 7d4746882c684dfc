"""The known quirks of instruments and products: a ledger that machines read.

Each has its dates, its effect on the data, what the readers do about it, and where it is known from. A spectrum carries
the names of those that apply to it in the attribute ``quirks``, with semicolons between them.
"""

import json
from functools import cache
from importlib import resources

import numpy as np
import xarray as xr
from pydantic import Field

from bella.records import Record

RESOURCE = "quirks.json"


class Quirk(Record):
    """A known quirk of an instrument or a product."""

    name: str = Field(description="Name that spectra carry; several spacecraft may share one.")
    observatory: str
    receivers: tuple[str, ...] = Field(description="Receivers concerned; none means all.")
    products: tuple[str, ...] = Field(description="Beginnings of file names, lower case; none means all.")
    first: str = Field(description="First day, UTC.")
    last: str | None = Field(description="Last day, UTC; null where it goes on.")
    effect: str
    handling: str = Field(description="What the readers do about it.")
    source: str

    def applies_to(self, spectrum: xr.Dataset) -> bool:
        """Whether a dynamic spectrum has it: by spacecraft, receiver, names of its files, and days."""
        if spectrum.attrs["observatory"] != self.observatory:
            return False
        held = set(str(spectrum.attrs["receiver"]).split("+"))
        names = [str(name).lower() for name in np.atleast_1d(spectrum.attrs.get("source_files", ()))]
        begin, end = spectrum["time"].to_numpy()[[0, -1]].astype("datetime64[D]")
        return (
            (not self.receivers or bool(held & set(self.receivers)))
            and (not self.products or any(name.startswith(self.products) for name in names))
            and end >= np.datetime64(self.first)
            and (self.last is None or begin <= np.datetime64(self.last))
        )


@cache
def quirks() -> tuple[Quirk, ...]:
    """All known quirks, in the order of the ledger."""
    stored = json.loads((resources.files("bella.spectra") / RESOURCE).read_text(encoding="utf-8"))
    return tuple(Quirk.model_validate(one) for one in stored)


def quirks_of(spectrum: xr.Dataset) -> list[str]:
    """Names of the quirks that apply to a dynamic spectrum."""
    return list(dict.fromkeys(one.name for one in quirks() if one.applies_to(spectrum)))

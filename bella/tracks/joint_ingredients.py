"""What a joint fit takes in, and how it is made: arrival times, wave directions, a wind known from elsewhere."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError
from bella.tracks.joint_directions import DirectionTerms
from bella.tracks.joint_likelihood import timed_channels
from bella.tracks.joint_observed import ARRIVAL_TIMES, WAVE_DIRECTIONS, WIND, Observed, WindPrior
from bella.units import FloatArray

DRAWS = 4000


@dataclass(frozen=True)
class JointOptions:
    """How the posterior of a joint fit is found.

    Attributes
    ----------
    draws : int
    seed : int
    robust : bool
        Weight bad arrival times down.
    fallback : bool
        Sample with PyMC where importance sampling has too few effective draws: up to a minute.
    near : mapping of str to ndarray, or None
        Standard parameters by name, of places near which maxima are; None: they are looked for everywhere.
    """

    draws: int = DRAWS
    seed: int = 0
    robust: bool = True
    fallback: bool = False
    near: Mapping[str, FloatArray] | None = None

    def __post_init__(self) -> None:
        if self.draws < 100:
            raise InputError(f"draws {self.draws}: give 100 draws or more")


@dataclass(frozen=True)
class Ingredients:
    """What is known of a burst.

    Attributes
    ----------
    arrivals : ArrivalGrid
        With the timing errors to use; frequencies heard by one or two receivers count too.
    common_sd_s : float or None
        Standard deviation of the offset that all channels of a receiver share, s; None: that of the grid, and where it
        has none the one that :func:`bella.tracks.joint_likelihood.common_offset_s` assumes.
    directions : DirectionTerms or None
    wind : WindPrior or None
    without_arrivals : bool
        Leave the arrival times out, to see what the rest says.
    """

    arrivals: ArrivalGrid
    common_sd_s: float | None = None
    directions: DirectionTerms | None = None
    wind: WindPrior | None = None
    without_arrivals: bool = False

    def __post_init__(self) -> None:
        if self.common_sd_s is not None and not 0 <= self.common_sd_s < np.inf:
            raise InputError(f"common offset {self.common_sd_s} s: give 0 s or more")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of those that are there."""
        there = {
            ARRIVAL_TIMES: not self.without_arrivals,
            WAVE_DIRECTIONS: self.directions is not None,
            WIND: self.wind is not None,
        }
        return tuple(name for name, on in there.items() if on)

    def without(self, name: str) -> "Ingredients":
        """The same less one ingredient.

        Parameters
        ----------
        name : str
            One of `names`.

        Returns
        -------
        Ingredients

        Raises
        ------
        InputError
            If it is not there.
        """
        if name not in self.names:
            raise InputError(f"ingredient {name!r} is not there; choose one of {', '.join(self.names)}")
        if name == ARRIVAL_TIMES:
            return replace(self, without_arrivals=True)
        return replace(self, directions=None) if name == WAVE_DIRECTIONS else replace(self, wind=None)

    def observed(self) -> Observed:
        """As the likelihood takes them."""
        channels = None if self.without_arrivals else timed_channels(self.arrivals, self.common_sd_s)
        return Observed(channels, self.directions, self.wind)

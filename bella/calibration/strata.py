"""The cases that are calibrated: geometry, timing error and model of each, and those where the model is wrong."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bella.exceptions import InputError
from bella.heliosphere.scattering import NO_DELAY, DirectionalDelay
from bella.multilateration.priors import PRESETS, Noise, Priors
from bella.units import AU_RSUN, FloatArray

DEFAULT = PRESETS["default"]
PAPER = PRESETS["bella-2024"]
FREE_SPEED = Priors(v_sd_c=0.1)
SUBLUMINAL = Priors(v_sd_c=0.1, v_max_c=1.0)
ROBUST = PRESETS["robust"].noise

NEARER_RECEIVERS = ((0.5, 40.0, 30.0), (0.8, -60.0, -25.0))
"""Fourth and fifth receiver: distance (au), longitude and, for a source in space, latitude (degrees)."""
FEWEST_RECEIVERS = 3


@dataclass(frozen=True)
class Misfit:
    """How the arrival times depart from the model that is fitted to them.

    Attributes
    ----------
    what : str
        In words.
    error_factor : float
        True over stated timing error.
    late_s : float
        Delay of one receiver, another for each source, s.
    least_delay_s, most_delay_s : float
        Delay of a receiver that looks at the source along the line from the Sun, and of one that looks from behind, s.
    on_spiral : bool
        Whether the sources lie on Parker spirals and not where the prior says.
    """

    what: str
    error_factor: float = 1.0
    late_s: float = 0.0
    least_delay_s: float = 0.0
    most_delay_s: float = 0.0
    on_spiral: bool = False


@dataclass(frozen=True)
class Stratum:
    """One case: where the receivers are, how well they time, and what is fitted.

    Attributes
    ----------
    name : str
        As the command line takes it.
    receivers : int
        Three at 1 au, one of them on either side of the Earth; then those of `NEARER_RECEIVERS`.
    separation_deg : float
        Longitude between the Earth and each of the other two.
    sigma_s : float
        Timing error of every receiver, s.
    dimensions : int
        3: the source is in space, and so are the fourth and the fifth receiver.
    offset_sd_s : float
        Standard deviation of the timing offset of each receiver, s.
    misfit : Misfit or None
        None where truth and fitted model are the same.
    """

    name: str
    receivers: int
    separation_deg: float
    sigma_s: float
    dimensions: int = 2
    priors: Priors = PAPER.priors
    noise: Noise = PAPER.noise
    offset_sd_s: float = 0.0
    delay: DirectionalDelay = NO_DELAY
    misfit: Misfit | None = None

    @property
    def receiver_rsun(self) -> FloatArray:
        """HEE positions, shape (n, 3), solar radii."""
        fleet = [(1.0, longitude, 0.0) for longitude in (0.0, self.separation_deg, -self.separation_deg)]
        fleet += NEARER_RECEIVERS[: self.receivers - FEWEST_RECEIVERS]
        range_au, longitude, latitude = np.array(fleet).T
        east, north = np.radians(longitude), np.radians(latitude if self.dimensions == 3 else 0 * latitude)
        unit = np.stack([np.cos(north) * np.cos(east), np.cos(north) * np.sin(east), np.sin(north)], axis=1)
        return np.asarray(range_au[:, None] * AU_RSUN * unit)

    @property
    def model(self) -> str:
        """What is fitted, in words."""
        priors = self.priors
        parts = [f"speed c ± {priors.v_sd_c:g} c"]
        if priors.is_truncated:
            parts.append(f"at most {priors.v_max_c:g} c")
        if self.noise.bad_probability:
            parts.append(f"{100 * self.noise.bad_probability:g} % bad arrival times")
        if self.offset_sd_s:
            parts.append(f"offsets of {self.offset_sd_s:g} s")
        if self.delay.is_free:
            parts.append(f"directional delay {self.delay.kappa:g} ± {self.delay.kappa_sd:g} of the rise")
        return ", ".join(parts)


OUTLIER = Misfit("one arrival time is 300 s late", late_s=300.0)

STRATA = (
    Stratum("together", 3, 10.0, 38.0),
    Stratum("near", 3, 40.0, 38.0),
    Stratum("near-sharp", 3, 40.0, 7.0),
    Stratum("wide", 3, 116.0, 38.0),
    Stratum("wide-coarse", 3, 116.0, 60.0),
    Stratum("wide-sharp", 3, 116.0, 7.0),
    Stratum("opposite", 3, 170.0, 38.0),
    Stratum("wide-speed", 3, 116.0, 38.0, priors=FREE_SPEED),
    Stratum("opposite-speed", 3, 170.0, 7.0, priors=FREE_SPEED),
    Stratum("four", 4, 116.0, 38.0),
    Stratum("four-offsets", 4, 116.0, 7.0, offset_sd_s=20.0),
    Stratum("four-robust", 4, 116.0, 38.0, noise=ROBUST),
    Stratum("four-subluminal", 4, 116.0, 38.0, priors=SUBLUMINAL),
    Stratum("wide-delay", 3, 116.0, 7.0, priors=DEFAULT.priors, delay=DEFAULT.delay),
    Stratum("four-delay", 4, 116.0, 7.0, priors=DEFAULT.priors, delay=DEFAULT.delay),
    Stratum("five-sharp", 5, 116.0, 7.0),
    Stratum("five-speed", 5, 116.0, 7.0, priors=FREE_SPEED),
    Stratum("five-subluminal", 5, 116.0, 7.0, priors=SUBLUMINAL),
    Stratum("five-robust", 5, 116.0, 7.0, noise=ROBUST),
    Stratum("space-four", 4, 116.0, 38.0, dimensions=3),
    Stratum("space-five", 5, 116.0, 7.0, dimensions=3),
    Stratum("space-speed", 5, 116.0, 38.0, dimensions=3, priors=FREE_SPEED),
    Stratum("on-spiral", 3, 116.0, 38.0, misfit=Misfit("sources on Parker spirals, 10 to 150 R_sun", on_spiral=True)),
    Stratum("sigma-halved", 3, 116.0, 38.0, misfit=Misfit("true error twice the stated one", error_factor=2.0)),
    Stratum("outlier", 4, 116.0, 38.0, misfit=OUTLIER),
    Stratum("outlier-robust", 4, 116.0, 38.0, noise=ROBUST, misfit=OUTLIER),
    Stratum(
        "undeclared-delay",
        3,
        116.0,
        38.0,
        misfit=Misfit(
            "late by 10 to 60 s, more where seen from behind, and nothing said of it",
            least_delay_s=10.0,
            most_delay_s=60.0,
        ),
    ),
)
"""Where the model is the truth first, then where it is not."""


def find_strata(names: Sequence[str] = ()) -> tuple[Stratum, ...]:
    """Strata of some names, in the order of the table.

    Parameters
    ----------
    names : sequence of str
        All if empty.

    Raises
    ------
    InputError
        Naming one that does not exist.
    """
    known = [stratum.name for stratum in STRATA]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise InputError(f"stratum {unknown[0]!r} is not known; choose from {', '.join(known)}")
    return tuple(stratum for stratum in STRATA if not names or stratum.name in names)

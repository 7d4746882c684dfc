"""What is assumed before the data: priors of source and speed, timing errors, and from where on a flag is raised."""

from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.special import gammaln, log_ndtr
from scipy.stats import truncnorm

from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError
from bella.heliosphere.scattering import LITERATURE_DELAY, NO_DELAY, DirectionalDelay
from bella.units import AU_RSUN, C_RSUN_S, FloatArray

SigmaRule = Literal["table", "cadence", "constant"]

CADENCE_S = {"WIND": 60.0, "STEREO-A": 38.05, "STEREO-B": 38.05}
"""Cadences used as timing error by Canizares et al. (2024), Sect. 2, s."""

PAPER_TAU_RSUN = 1.5 * AU_RSUN / 4
"""Width of the position prior of Canizares et al. (2024): a quarter of 1.5 au, 80.6 solar radii."""
BROAD_TAU_RSUN, BROAD_POWER = 300.0, 4.0
"""The default position prior, exp(-(r / 300)^4 / 2): flat to some 200 solar radii, 0.8 of its height at 250, and 0.02
at 500. Type III sources are seen from the corona to somewhat beyond the orbit of the Earth at 215, where the plasma
frequency of the solar wind is about 20 kHz, the lowest that receivers hear."""

MOST_BAD = 2
"""Most arrival times of one frequency that may be bad together."""


@dataclass(frozen=True)
class Priors:
    """Priors of one localisation.

    Attributes
    ----------
    tau_rsun : float
        Width of the prior of the position, centred on the Sun, solar radii.
    power : float
        The prior of the position is exp(-(r / tau)^power / 2) at a distance r: 2 for a Gaussian, and for more a plain
        that ends near tau.
    v_sd_c : float
        Standard deviation of the propagation speed around c, in units of c.
    v_max_c : float
        Speeds above this have no probability, in units of c.
    emission_half_width_s : float
        The emission time is uniform within this of the reference time, s.
    """

    tau_rsun: float = PAPER_TAU_RSUN
    power: float = 2.0
    v_sd_c: float = 0.001
    v_max_c: float = float("inf")
    emission_half_width_s: float = 86_400.0

    def log_position(self, squared_rsun2: FloatArray) -> FloatArray:
        """Log density of the position at a squared distance from the Sun, less its value at the Sun."""
        return np.asarray(-0.5 * (squared_rsun2 / self.tau_rsun**2) ** (0.5 * self.power))

    def position_slope(self, squared_rsun2: FloatArray) -> FloatArray:
        """Gradient of :meth:`log_position` over the position, at a squared distance from the Sun."""
        scaled = squared_rsun2 / self.tau_rsun**2
        return np.asarray(-0.5 * self.power / self.tau_rsun**2 * scaled ** (0.5 * self.power - 1))

    def position_sd_rsun(self, dimensions: int) -> float:
        """Standard deviation of each coordinate of the source, solar radii."""
        # r^power is a gamma variate: <r^2> = tau^2 2^(2/p) Gamma((D + 2)/p) / Gamma(D/p)
        log_square = gammaln((dimensions + 2) / self.power) - gammaln(dimensions / self.power)
        return float(self.tau_rsun * np.sqrt(np.exp(log_square) * 2 ** (2 / self.power) / dimensions))

    def log_volume(self, dimensions: int) -> float:
        """Logarithm of the integral of the density over space, whose value at the Sun is one."""
        of_sphere = np.log(2) + 0.5 * dimensions * np.log(np.pi) - gammaln(0.5 * dimensions)
        radial = gammaln(dimensions / self.power) + dimensions / self.power * np.log(2) - np.log(self.power)
        return float(of_sphere + radial + dimensions * np.log(self.tau_rsun))

    @property
    def slowness_mean(self) -> float:
        """Mean of the Gaussian in u = 1/v that stands in for the Gaussian in v, s per solar radius."""
        return (1 + self.v_sd_c**2) / C_RSUN_S

    @property
    def slowness_sd(self) -> float:
        """Standard deviation of that Gaussian, s per solar radius."""
        return self.v_sd_c * (1 + 2 * self.v_sd_c**2) / C_RSUN_S

    @property
    def is_truncated(self) -> bool:
        """Whether there is a largest speed."""
        return bool(np.isfinite(self.v_max_c))

    @property
    def speed_sd_c(self) -> float:
        """Standard deviation of the prior of the speed, below the largest one if there is one, in units of c."""
        return float(truncnorm.std(-np.inf, (self.v_max_c - 1) / self.v_sd_c, scale=self.v_sd_c))

    @property
    def log_share_allowed(self) -> float:
        """Logarithm of the share of the Gaussian in v that lies below the largest speed."""
        return float(log_ndtr((self.v_max_c - 1) / self.v_sd_c))


@dataclass(frozen=True)
class Noise:
    """How arrival times err: Gaussian with their stated errors, or now and then by far more.

    Each arrival time is bad with a small probability, and then its error is larger by far (the mixture of Box & Tiao
    1968, doi:10.1093/biomet/55.1.119). With three receivers a bad time cannot be told from a good one.

    Attributes
    ----------
    bad_probability : float
        Prior probability that an arrival time is bad; 0 for Gaussian noise.
    bad_sd_s : float
        Standard deviation that a bad one has beyond its stated error, s.
    """

    bad_probability: float = 0.0
    bad_sd_s: float = 600.0

    def bad_sets(self, receivers: int) -> npt.NDArray[np.bool_]:
        """Which receivers are bad in each component of the mixture: one of four at most, and two at most.

        Parameters
        ----------
        receivers : int
            Their number n.

        Returns
        -------
        ndarray of bool, shape (K, n)
            The first has none that is bad.
        """
        most = min(max(1, receivers // 4), MOST_BAD) if self.bad_probability > 0 else 0
        chosen = [some for size in range(most + 1) for some in combinations(range(receivers), size)]
        sets = np.zeros((len(chosen), receivers), dtype=bool)
        for row, some in enumerate(chosen):
            sets[row, list(some)] = True
        return sets


@dataclass(frozen=True)
class Preset:
    """A named choice of priors and timing error.

    Attributes
    ----------
    sigma_rule : {"table", "cadence", "constant"}
        Timing error from the arrival table, from the cadence of the receiver, or `sigma_s` for all.
    sigma_s : float
        Used by the rule "constant", s.
    """

    name: str
    priors: Priors
    sigma_rule: SigmaRule
    sigma_s: float = float("nan")
    noise: Noise = Noise()
    delay: DirectionalDelay = NO_DELAY

    @property
    def rule(self) -> str:
        """The timing error in words, to be stored with every solution."""
        if self.sigma_rule == "constant":
            return f"{self.sigma_s:g} s for every receiver"
        return {"table": "sigma_s of the arrival table", "cadence": "cadence of each receiver"}[self.sigma_rule]


BROAD = Priors(BROAD_TAU_RSUN, BROAD_POWER)
BROAD_FREE_SPEED = replace(BROAD, v_sd_c=0.1)

PRESETS = {
    preset.name: preset
    for preset in (
        Preset("default", BROAD, "table", delay=LITERATURE_DELAY),
        Preset("paper", Priors(v_sd_c=0.1), "cadence"),
        Preset("bella-2024", Priors(), "constant", sigma_s=30.0),
        Preset("free-speed", BROAD_FREE_SPEED, "table", delay=LITERATURE_DELAY),
        Preset("subluminal", replace(BROAD_FREE_SPEED, v_max_c=1.0), "table", delay=LITERATURE_DELAY),
        Preset("robust", BROAD, "table", noise=Noise(bad_probability=0.05), delay=LITERATURE_DELAY),
    )
}
"""``default``: timing errors as measured, sources anywhere to beyond 1 au, and a directional delay. ``paper``: what
Canizares et al. (2024) say. ``bella-2024``: what the code published with that paper does (half of the 60 s cadence for
all receivers, speed held to 0.001 c). With the timing errors of the table as well: ``free-speed`` leaves the speed
0.1 c, ``subluminal`` does so below c only, and ``robust`` allows for bad arrival times: it names one among five, and
knows that there is one among four, but not always which."""


@dataclass(frozen=True)
class Thresholds:
    """Limits from which on a flag is raised; numbers that only steer a method stand beside it.

    Attributes
    ----------
    late_clock_sd : float
        An offset of a receiver of so many of its standard deviations is flagged. With good clocks and errors of 5 s one
        burst in 30 of five receivers was, and none in 30 of four.
    doubtful_clock_sd : float
        From so many on positions allow for a late clock: an offset of 10 s with errors of 5 s is below the limit of the
        flag in half of the bursts of four receivers.
    alike_clock_chi2 : float
        Receivers whose offsets lower chi-squared by so much less than the best one's, two standard deviations, are
        named beside it.
    typical_offset_s : float
        Size of an offset where a clock is off: between the sample of a receiver and an error of the time scale, 69 s.
    inconsistent_once_in : float
        How often arrival times with errors as stated may be called inconsistent: once in all frequencies of some
        hundred bursts.
    dominated_sd : float
        Move of the mean by the prior of the position, in standard deviations, from which the prior is said to decide.
    likely_above_c : float
        Probability of v > c, one half in the prior, from which the arrival times are said to prefer it.
    likely_bad : float
        Probability from which an arrival time is named bad: more likely than not.
    few_draws_share : float
        Effective share of the draws below which they are said to be few.
    mode_nats : float
        Local maxima of the density this far below the best are no modes: they hold less than a hundredth.
    mode_depth_nats : float
        A maximum is a mode of its own when every way from it to a higher one leads this far down: to 0.6 of its height.
    closed_form_off : float
        Relative difference from the exact standard deviation above which the closed form of a map counts as off.
    largest_rhat, fewest_sampled : float
        Beyond these the chains of the sampler count as disagreeing: five times the 0.01 of Vehtari et al. (2021,
        doi:10.1214/20-BA1221) for a reference that is only compared with, and a quarter of their 400 draws.
    """

    late_clock_sd: float = 3.0
    doubtful_clock_sd: float = 2.0
    alike_clock_chi2: float = 4.0
    typical_offset_s: float = 20.0
    inconsistent_once_in: float = 10_000.0
    dominated_sd: float = 0.5
    likely_above_c: float = 0.95
    likely_bad: float = 0.5
    few_draws_share: float = 0.5
    mode_nats: float = 6.0
    mode_depth_nats: float = 0.5
    closed_form_off: float = 0.1
    largest_rhat: float = 1.05
    fewest_sampled: float = 100.0


THRESHOLDS = Thresholds()


def find_preset(name: str) -> Preset:
    """Preset of a name.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in PRESETS:
        raise InputError(f"preset {name!r} is not known; choose one of {', '.join(PRESETS)}")
    return PRESETS[name]


def apply_sigma_rule(grid: ArrivalGrid, preset: Preset) -> ArrivalGrid:
    """Replace the timing errors of a grid as a preset says; what is missing stays missing, offsets and delays stay.

    Raises
    ------
    InputError
        If the rule needs the cadence of a receiver for which none is known.
    """
    if preset.sigma_rule == "table":
        return grid
    sigma_s = np.broadcast_to(_sigma_per_receiver(grid.observatories, preset), grid.sigma_s.shape)
    sigma_s = np.where(np.isfinite(grid.sigma_s), sigma_s, np.nan)
    return replace(grid, sigma_s=sigma_s, shape_sd_s=np.zeros_like(grid.shape_sd_s), measured_s2=None)


def fleet_sigma(
    receivers: pd.DataFrame, preset: Preset, given: dict[str, float] | float | None
) -> dict[str, float] | float | None:
    """Timing errors of a fleet: what is given, else what the preset says, else the table.

    Parameters
    ----------
    receivers : pandas.DataFrame
        With columns observatory and sigma_s (s, NaN where it is not known).
    given : dict of str to float, or float, or None
        Of some spacecraft, of all alike, or of none, s.

    Returns
    -------
    dict of str to float, or float, or None
        s; a spacecraft that is missing has the error that follows from its cadence.
    """
    if isinstance(given, float):
        return given
    ruled: dict[str, float] = {}
    if preset.sigma_rule == "constant":
        ruled = dict.fromkeys(receivers["observatory"], preset.sigma_s)
    elif preset.sigma_rule == "table":
        timed = receivers.dropna(subset=["sigma_s"])
        ruled = dict(zip(timed["observatory"], timed["sigma_s"], strict=True))
    return ruled | (given or {})


def _sigma_per_receiver(observatories: tuple[str, ...], preset: Preset) -> FloatArray:
    if preset.sigma_rule == "constant":
        return np.full(len(observatories), preset.sigma_s)
    unknown = [name for name in observatories if name not in CADENCE_S]
    if unknown:
        raise InputError(f"preset {preset.name!r} has no cadence for {unknown[0]}; use --preset default")
    return np.array([CADENCE_S[name] for name in observatories])

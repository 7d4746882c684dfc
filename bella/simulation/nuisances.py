"""What fills radio spectra beside Type III bursts: shapes as receivers of space missions show them.

Each is a patch of the spectrum with an excess over background in it: arcs of Jupiter (above about 1 MHz, drifting
either way), auroral kilometric radiation of Earth (Gurnett 1974, doi:10.1029/JA079i028p04227; 50 to 600 kHz), lanes of
Type II bursts (Cane et al. 1987, doi:10.1029/JA092iA09p09869). Interference, calibration and hits of energetic
particles belong to the spacecraft. Strengths and durations are of the order seen in daily spectra, not fitted to a
survey.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bella.units import FloatArray


class Nuisance(Protocol):
    """A patch of excess power; times are seconds after midnight of its day."""

    @property
    def kind(self) -> str:
        """What it is, in one word."""

    @property
    def start_s(self) -> float:
        """When it begins, s."""

    @property
    def stop_s(self) -> float:
        """When it ends, s."""

    @property
    def band_mhz(self) -> tuple[float, float]:
        """Lowest and highest frequency, MHz."""

    def excess(self, time_s: FloatArray, frequency_mhz: FloatArray) -> FloatArray:
        """Power in units of the background, shape (N, C), at times (N, 1) or (N, C) and frequencies (C,)."""


def add_nuisance(power: FloatArray, nuisance: Nuisance, time_s: FloatArray, frequency_mhz: FloatArray) -> None:
    """Add a nuisance to the power of a spectrum, in place.

    Parameters
    ----------
    power : numpy.ndarray, shape (N, C)
        In units of the background.
    time_s : numpy.ndarray, shape (N, C)
        Of every sample, ascending in every channel, seconds after midnight.
    frequency_mhz : numpy.ndarray, shape (C,)
        Ascending.
    """
    low, high = nuisance.band_mhz
    rows = slice(
        np.searchsorted(time_s.max(axis=1), nuisance.start_s), np.searchsorted(time_s.min(axis=1), nuisance.stop_s)
    )
    columns = slice(np.searchsorted(frequency_mhz, low), np.searchsorted(frequency_mhz, high, side="right"))
    if rows.stop > rows.start and columns.stop > columns.start:
        when_s = time_s[rows, columns]
        is_on = (when_s >= nuisance.start_s) & (when_s < nuisance.stop_s)
        power[rows, columns] += is_on * nuisance.excess(when_s, frequency_mhz[columns])


@dataclass(frozen=True)
class JovianArc:
    """An arc of Jupiter: a narrow band that bends over in time, so that it drifts both ways.

    Attributes
    ----------
    vertex_s : float
        When its middle frequency is reached, s.
    bend_s : float
        How much later (or earlier, below 0) its ends come, s.
    width_s : float
        How long it lasts at one frequency, s.
    height : float
        Peak over background.
    """

    vertex_s: float
    band_mhz: tuple[float, float]
    bend_s: float
    width_s: float
    height: float
    kind: str = "jovian_arc"

    @property
    def start_s(self) -> float:
        """When it begins, s."""
        return self.vertex_s + min(0.0, self.bend_s) - 4 * self.width_s

    @property
    def stop_s(self) -> float:
        """When it ends, s."""
        return self.vertex_s + max(0.0, self.bend_s) + 4 * self.width_s

    def excess(self, time_s: FloatArray, frequency_mhz: FloatArray) -> FloatArray:
        """Power in units of the background, shape (N, C)."""
        low, high = self.band_mhz
        place = (2 * frequency_mhz - low - high) / (high - low)
        after = (time_s - self.vertex_s - self.bend_s * place**2) / self.width_s
        return np.asarray(self.height * np.exp(-0.5 * after**2) * np.sqrt(np.clip(1 - place**2, 0, 1)))


@dataclass(frozen=True)
class Patches:
    """Clouds of radiation without a drift of their own, as auroral kilometric radiation shows.

    Attributes
    ----------
    height : float
        Of the brightest patch.
    seed : int
        Of where they are.
    """

    kind: str
    start_s: float
    stop_s: float
    band_mhz: tuple[float, float]
    height: float
    patches: int
    seed: int

    def excess(self, time_s: FloatArray, frequency_mhz: FloatArray) -> FloatArray:
        """Power in units of the background, shape (N, C)."""
        random = np.random.default_rng(self.seed)
        low, high = np.log(self.band_mhz)
        total = np.zeros((len(time_s), frequency_mhz.size))
        for _ in range(self.patches):
            middle_s, length_s = random.uniform(self.start_s, self.stop_s), random.uniform(60, 500)
            place, width = random.uniform(low, high), random.uniform(0.05, 0.3)
            height = self.height * random.uniform(0.1, 1)
            shape = np.exp(-0.5 * ((np.log(frequency_mhz) - place) / width) ** 2)
            total += height * shape * np.exp(-0.5 * ((time_s - middle_s) / length_s) ** 2)
        return total


@dataclass(frozen=True)
class TypeTwoLane:
    """A lane of a Type II burst: a shock that takes hours from the corona to 1 au.

    Attributes
    ----------
    band_mhz : tuple of float
        Its highest frequency is where it begins.
    width : float
        Bandwidth over frequency.
    period_s : float
        Between its brightenings, s.
    """

    start_s: float
    stop_s: float
    band_mhz: tuple[float, float]
    width: float
    height: float
    period_s: float
    kind: str = "type_ii_lane"

    def excess(self, time_s: FloatArray, frequency_mhz: FloatArray) -> FloatArray:
        """Power in units of the background, shape (N, C)."""
        low, high = self.band_mhz
        share = (time_s - self.start_s) / (self.stop_s - self.start_s)
        centre = high / (1 + share * (high / low - 1))
        bright = 0.5 + 0.5 * np.sin(2 * np.pi * time_s / self.period_s)
        return np.asarray(self.height * bright * np.exp(-0.5 * (np.log(frequency_mhz / centre) / self.width) ** 2))


@dataclass(frozen=True)
class InterferenceLine:
    """A channel or two that the spacecraft itself disturbs, on and off.

    Attributes
    ----------
    period_s : float
        Of being on and off, s.
    """

    start_s: float
    stop_s: float
    band_mhz: tuple[float, float]
    height: float
    period_s: float
    kind: str = "interference"

    def excess(self, time_s: FloatArray, frequency_mhz: FloatArray) -> FloatArray:
        """Power in units of the background, shape (N, C)."""
        is_on = (time_s / self.period_s) % 1.0 < 0.6
        return np.asarray(self.height * is_on * np.ones(frequency_mhz.shape))


@dataclass(frozen=True)
class CalibrationColumn:
    """All channels up at once, while the receiver looks at its own source."""

    start_s: float
    stop_s: float
    height: float
    kind: str = "calibration"
    band_mhz: tuple[float, float] = (1e-3, 1e3)

    def excess(self, time_s: FloatArray, frequency_mhz: FloatArray) -> FloatArray:
        """Power in units of the background, shape (N, C)."""
        return np.full((len(time_s), frequency_mhz.size), self.height)


@dataclass(frozen=True)
class ParticleHits:
    """Single samples lifted by energetic particles.

    Attributes
    ----------
    share : float
        Of samples that are hit.
    height : float
        Mean excess of a sample that is.
    """

    start_s: float
    stop_s: float
    share: float
    height: float
    seed: int
    kind: str = "particle_hits"
    band_mhz: tuple[float, float] = (1e-3, 1e3)

    def excess(self, time_s: FloatArray, frequency_mhz: FloatArray) -> FloatArray:
        """Power in units of the background, shape (N, C)."""
        random = np.random.default_rng(self.seed)
        shape = (len(time_s), frequency_mhz.size)
        return np.asarray((random.random(shape) < self.share) * random.exponential(self.height, shape))

"""What is to be heard on a day: bursts, storms of weak ones, and what is none, drawn at random.

Bursts do not follow the laws of the templates they are searched with: their widths, densities, drifts, bands and
brightnesses scatter. Numbers are of the order of what daily spectra of solar maximum show.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import date

import numpy as np

from bella.simulation.burst import SimulatedBurst
from bella.simulation.nuisances import (
    CalibrationColumn,
    InterferenceLine,
    JovianArc,
    Nuisance,
    ParticleHits,
    Patches,
    TypeTwoLane,
)
from bella.units import DAY_S

MEAN_BURSTS = 6.0
GROUP_PROBABILITY = 0.25
KILOMETRIC_FROM = ("WIND",)
"""Spacecraft near enough to Earth to be flooded by its kilometric radiation."""


@dataclass(frozen=True)
class Gain:
    """How the gain of a receiver wanders through a day: a slow wave, and a step.

    Attributes
    ----------
    wave_db : float
        Amplitude of the wave, of which the day is one period, dB.
    step_db : float
    step_s : float
        Seconds after midnight.
    """

    wave_db: float = 0.0
    step_db: float = 0.0
    step_s: float = 0.0

    def factor(self, time_s: np.ndarray) -> np.ndarray:
        """Power over that without the wandering, shape of `time_s`, seconds after midnight."""
        decibel = self.wave_db * np.sin(2 * np.pi * time_s / DAY_S) + self.step_db * (time_s > self.step_s)
        return np.asarray(10.0 ** (0.1 * decibel))


@dataclass(frozen=True)
class Conditions:
    """What one spacecraft has on a day beside bursts.

    Attributes
    ----------
    nuisances : tuple of Nuisance
    gaps_s : tuple of (float, float)
        When nothing was recorded, seconds after midnight.
    gain : Gain
    clip : float
        Largest power that the receiver gives, in units of the background: brighter peaks are flat.
    lowest_mhz : float
        Channels below have no data.
    fast_from_s : float
        When the receiver begins to sample in the fast one of its modes, seconds after midnight; infinite for a receiver
        that stays in the mode it is in.
    """

    nuisances: tuple[Nuisance, ...] = ()
    gaps_s: tuple[tuple[float, float], ...] = ()
    gain: Gain = Gain()
    clip: float = np.inf
    lowest_mhz: float = 0.0
    fast_from_s: float = np.inf


@dataclass(frozen=True)
class Sky:
    """What is to be heard on a day.

    Attributes
    ----------
    day : datetime.date
    bursts : tuple of SimulatedBurst
        In order of their release.
    storm : tuple of SimulatedBurst
        Weak bursts of a noise storm, not to be told from one another.
    conditions : dict of str to Conditions
        By observatory.
    """

    day: date
    bursts: tuple[SimulatedBurst, ...]
    storm: tuple[SimulatedBurst, ...]
    conditions: dict[str, Conditions]


def draw_sky(day: date, observatories: Sequence[str], rng: np.random.Generator) -> Sky:
    """Draw what is to be heard on a day.

    Parameters
    ----------
    day : datetime.date
    observatories : sequence of str
    rng : numpy.random.Generator

    Returns
    -------
    Sky
    """
    bursts: list[SimulatedBurst] = []
    for _ in range(rng.poisson(MEAN_BURSTS)):
        burst = draw_burst(day, rng)
        bursts.append(burst)
        if rng.random() < GROUP_PROBABILITY:
            bursts += _group(burst, rng)
    storm = _storm(day, rng) if rng.random() < 0.25 else ()
    arcs = _jovian_arcs(rng) if rng.random() < 0.4 else ()
    conditions = {name: _conditions(name, arcs, rng) for name in observatories}
    return Sky(day, tuple(sorted(bursts, key=lambda one: one.release_utc)), storm, conditions)


def draw_burst(day: date, rng: np.random.Generator) -> SimulatedBurst:
    """Draw a burst at any time of a day, on any side of the Sun.

    Parameters
    ----------
    day : datetime.date
    rng : numpy.random.Generator

    Returns
    -------
    SimulatedBurst
    """
    starts_high = rng.random() < 0.7
    return SimulatedBurst(
        release_utc=np.datetime64(day, "ns") + np.timedelta64(int(rng.uniform(0, DAY_S) * 1e9), "ns"),
        phi0_deg=float(rng.uniform(-180, 180)),
        v_sw_km_s=float(np.clip(rng.normal(400, 70), 280, 700)),
        beam_speed_c=float(np.clip(rng.lognormal(np.log(0.15), 0.4), 0.06, 0.4)),
        density=str(rng.choice(["leblanc", "saito"])),
        density_factor=float(rng.uniform(1, 4)),
        harmonic=int(rng.choice([1, 2])),
        f_low_mhz=float(np.exp(rng.uniform(np.log(0.12), np.log(0.6)))),
        f_high_mhz=float(rng.uniform(9, 16) if starts_high else np.exp(rng.uniform(np.log(1.0), np.log(6.0)))),
        contrast=float(10 ** (0.1 * rng.uniform(3, 30))),
        width_factor=float(rng.lognormal(0.0, 0.25)),
        taper=0.3,
        directivity=0.7,
    )


def _later(burst: SimulatedBurst, seconds: float) -> np.datetime64:
    return burst.release_utc + np.timedelta64(int(seconds * 1e9), "ns")


def _group(first: SimulatedBurst, rng: np.random.Generator) -> list[SimulatedBurst]:
    """Beams that follow from the same place within minutes."""
    times = np.cumsum(rng.uniform(90, 500, rng.integers(1, 4)))
    return [
        replace(
            first,
            release_utc=_later(first, seconds),
            contrast=first.contrast * 10 ** rng.uniform(-0.6, 0.2),
            beam_speed_c=float(np.clip(first.beam_speed_c * rng.lognormal(0, 0.2), 0.06, 0.4)),
        )
        for seconds in times
    ]


def _storm(day: date, rng: np.random.Generator) -> tuple[SimulatedBurst, ...]:
    """Weak narrow bursts from one active region, every few minutes for hours."""
    start, length = rng.uniform(0, 0.6 * DAY_S), rng.uniform(3, 9) * 3600
    phi0 = float(rng.uniform(-180, 180))
    model = draw_burst(day, rng)
    storm = []
    for second in np.sort(rng.uniform(start, min(start + length, DAY_S), int(length / rng.uniform(150, 400)))):
        high = float(rng.uniform(1.0, 5.0))
        storm.append(
            replace(
                model,
                release_utc=np.datetime64(day, "ns") + np.timedelta64(int(second * 1e9), "ns"),
                phi0_deg=phi0,
                f_low_mhz=0.25 * high,
                f_high_mhz=high,
                contrast=float(10 ** (0.1 * rng.uniform(0, 7))),
            )
        )
    return tuple(storm)


def _jovian_arcs(rng: np.random.Generator) -> tuple[Nuisance, ...]:
    start = rng.uniform(0, 0.85 * DAY_S)
    middles = start + np.cumsum(rng.uniform(300, 1500, rng.integers(3, 10)))
    low, high = rng.uniform(1.5, 4), rng.uniform(7, 15)
    side = rng.choice([-1, 1])
    return tuple(
        JovianArc(
            float(middle),
            (low * rng.uniform(1, 1.3), high * rng.uniform(0.8, 1)),
            float(side * rng.uniform(100, 900)),
            float(rng.uniform(40, 200)),
            float(10 ** rng.uniform(0, 1)),
        )
        for middle in middles
    )


def _conditions(observatory: str, arcs: tuple[Nuisance, ...], rng: np.random.Generator) -> Conditions:
    nuisances = list(arcs)
    for probability, draw in _LOCAL:
        if rng.random() < probability:
            nuisances.append(draw(rng))
    if observatory in KILOMETRIC_FROM and rng.random() < 0.6:
        nuisances.append(_kilometric(rng))
    gaps = [(start, start + rng.uniform(120, 2400)) for start in rng.uniform(0, DAY_S, rng.poisson(0.7))]
    gain = Gain(float(rng.uniform(0, 0.5)), float(rng.choice([0.0, 1.5, -1.5], p=[0.8, 0.1, 0.1])), _anytime(rng))
    return Conditions(tuple(nuisances), tuple(gaps), gain)


def _anytime(rng: np.random.Generator) -> float:
    return float(rng.uniform(0.05, 0.95) * DAY_S)


def _kilometric(rng: np.random.Generator) -> Nuisance:
    start, length = _anytime(rng), rng.uniform(1, 5) * 3600
    height = float(10 ** rng.uniform(0.5, 2.5))
    return Patches(
        "kilometric", start, start + length, (0.08, 0.6), height, int(length / 400), int(rng.integers(2**31))
    )


def _type_two(rng: np.random.Generator) -> Nuisance:
    start = rng.uniform(0, 0.7) * DAY_S
    height, width = float(10 ** rng.uniform(0.2, 1)), float(rng.uniform(0.04, 0.12))
    stop = start + rng.uniform(3, 10) * 3600
    return TypeTwoLane(start, stop, (rng.uniform(0.2, 0.6), rng.uniform(6, 12)), width, height, rng.uniform(600, 3000))


def _line(rng: np.random.Generator) -> Nuisance:
    middle, start = float(np.exp(rng.uniform(np.log(0.15), np.log(14)))), _anytime(rng)
    band = (middle * 0.99 - 0.01, middle * 1.01 + 0.01)
    return InterferenceLine(
        start, start + rng.uniform(0.5, 8) * 3600, band, 10 ** rng.uniform(0, 1), rng.uniform(120, 3600)
    )


def _calibration(rng: np.random.Generator) -> Nuisance:
    start = _anytime(rng)
    return CalibrationColumn(start, start + rng.uniform(60, 120), float(10 ** rng.uniform(0.3, 2)))


def _hits(rng: np.random.Generator) -> Nuisance:
    start = _anytime(rng)
    return ParticleHits(start, start + rng.uniform(2, 10) * 3600, 0.01, 3.0, int(rng.integers(2**31)))


_LOCAL: tuple[tuple[float, Callable[[np.random.Generator], Nuisance]], ...] = (
    (0.15, _type_two),
    (0.5, _line),
    (0.3, _line),
    (0.5, _calibration),
    (0.5, _calibration),
    (0.1, _hits),
)

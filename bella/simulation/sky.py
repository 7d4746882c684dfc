"""What is to be received on a day: bursts, storms of weak ones, and what is none, drawn at random.

Bursts do not follow the laws of the templates they are searched with: their light curves, widths, densities, drifts,
bands and brightnesses scatter. How a burst departs from a single pulse of a beam of constant speed is its stratum.
Numbers without a source are of the order of what daily spectra of solar maximum show.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import date

import numpy as np

from bella.simulation.burst import DENSITIES, SPEED_LAWS, Aspect, Companion, SimulatedBurst
from bella.simulation.light_curves import draw_pulse_law
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
CLIPPED, MODE_CHANGE = 0.05, 0.1
"""Share of spacecraft-days on which bright peaks are clipped, and on which a receiver with modes changes into the fast
one."""

KILOMETRIC_FROM = ("WIND",)
"""Spacecraft near enough to Earth to be flooded by its kilometric radiation."""

FAST_WIND, SLOW_KM_S, FAST_KM_S, WIND_LIMITS_KM_S = 0.35, (350.0, 40.0), (520.0, 70.0), (260.0, 750.0)
"""Share of bursts in fast wind, mean and scatter of slow and fast wind, and limits, km/s: wind at 1 au has two states
(Schwenn 1990, in Physics of the Inner Heliosphere I, doi:10.1007/978-3-642-75361-9_4)."""

BEAM_C = (0.06, 0.14, 0.36)
"""Least, most probable and largest speed of a beam, in units of c (Reid & Ratcliffe 2014, Res. Astron. Astrophys. 14,
773, doi:10.1088/1674-4527/14/7/003: 0.1 to 0.5 near the Sun, less farther out)."""

DENSITY_FACTOR = (0.7, 3.5)
DIRECTIVITY = (0.7, 2.5)
KAPPA = (0.1, 0.3)
"""Delay of a receiver at a right angle in half widths of the rise: what the delays in simulations of scattering come
to (Kontar et al. 2019, ApJ 884, 122, doi:10.3847/1538-4357/ab40bb; Chen et al. 2023, MNRAS 520, 3117)."""


@dataclass(frozen=True)
class Gain:
    """How the gain of a receiver wanders through a day: a slow wave, and a step.

    Attributes
    ----------
    wave_db : float
        Amplitude of the wave, of which the day is one period, dB.
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
    gaps_s : tuple of (float, float)
        When nothing was recorded, seconds after midnight.
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
    """What is to be received on a day.

    Attributes
    ----------
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
    """Draw what is to be received on a day."""
    bursts: list[SimulatedBurst] = []
    for _ in range(rng.poisson(MEAN_BURSTS)):
        burst = _of_a_stratum(draw_burst(day, rng), observatories, rng)
        bursts.append(burst)
        if rng.random() < GROUP_PROBABILITY:
            bursts += _group(burst, rng)
    storm = _storm(day, rng) if rng.random() < 0.25 else ()
    arcs = _jovian_arcs(rng) if rng.random() < 0.4 else ()
    conditions = {name: _conditions(name, arcs, rng) for name in observatories}
    return Sky(day, tuple(sorted(bursts, key=lambda one: one.release_utc)), storm, conditions)


def draw_burst(day: date, rng: np.random.Generator) -> SimulatedBurst:
    """Draw a burst at any time of a day, on any side of the Sun: a single pulse of a beam of constant speed."""
    starts_high, fast_wind = rng.random() < 0.7, rng.random() < FAST_WIND
    return SimulatedBurst(
        release_utc=np.datetime64(day, "ns") + np.timedelta64(int(rng.uniform(0, DAY_S) * 1e9), "ns"),
        phi0_deg=float(rng.uniform(-180, 180)),
        v_sw_km_s=float(np.clip(rng.normal(*(FAST_KM_S if fast_wind else SLOW_KM_S)), *WIND_LIMITS_KM_S)),
        beam_speed_c=float(rng.triangular(*BEAM_C)),
        density=str(rng.choice(list(DENSITIES))),
        density_factor=float(np.exp(rng.uniform(*np.log(DENSITY_FACTOR)))),
        harmonic=int(rng.choice([1, 2])),
        f_low_mhz=float(np.exp(rng.uniform(np.log(0.12), np.log(0.6)))),
        f_high_mhz=float(rng.uniform(9, 16) if starts_high else np.exp(rng.uniform(np.log(1.0), np.log(6.0)))),
        contrast=float(10 ** (0.1 * rng.uniform(3, 30))),
        pulse=draw_pulse_law(rng),
        taper=0.3,
        directivity=float(rng.uniform(*DIRECTIVITY)),
        stratum="clean",
    )


def slowing(burst: SimulatedBurst, names: Sequence[str], rng: np.random.Generator) -> SimulatedBurst:  # noqa: ARG001
    """A beam that slows down, with the drawn speed at 30 solar radii."""
    law = str(rng.choice([name for name in SPEED_LAWS if name != "constant"]))
    strength = float(rng.uniform(0.1, 0.45) if law == "power" else rng.uniform(0.5, 2.5))
    there = float(SPEED_LAWS[law](np.array([30.0]), strength)[0])
    return replace(burst, speed_law=law, slowing=strength, beam_speed_c=min(burst.beam_speed_c / there, 0.8))


def directional(
    burst: SimulatedBurst,
    names: Sequence[str],  # noqa: ARG001
    rng: np.random.Generator,
) -> SimulatedBurst:
    """A delay that grows with the angle from the direction in which the source points."""
    return replace(burst, kappa=float(rng.uniform(*KAPPA)))


def pairs(burst: SimulatedBurst, names: Sequence[str], rng: np.random.Generator) -> SimulatedBurst:
    """Fundamental and harmonic together; which of them is the brighter differs between spacecraft."""
    fundamental = Companion(
        harmonic=1,
        height=float(np.exp(rng.uniform(np.log(0.3), np.log(3.0)))),
        rise_factor=float(rng.uniform(0.6, 1.0)),
        directivity=float(rng.uniform(0.2, 0.6)),
    )
    aspects = {name: Aspect(companion_height=float(rng.lognormal(0.0, 0.5))) for name in names}
    return replace(burst, harmonic=2, companion=fundamental, aspects=aspects)


def widths(burst: SimulatedBurst, names: Sequence[str], rng: np.random.Generator) -> SimulatedBurst:
    """Light curves that are wider from the side, and whose rise and decay differ between spacecraft.

    Rise and decay do not depend on the observer's angle in Chrysaphi et al. 2024, A&A 687, L12,
    doi:10.1051/0004-6361/202348175; on 2012-06-07 STEREO-A rises 28 % more slowly and Wind 23 % faster than the mean.
    """
    aspects = {
        name: Aspect(rise=float(rng.lognormal(0.0, 0.15)), decay=float(rng.lognormal(0.0, 0.25))) for name in names
    }
    return replace(burst, widening=float(rng.uniform(0.0, 0.7)), aspects=aspects)


def double(burst: SimulatedBurst, names: Sequence[str], rng: np.random.Generator) -> SimulatedBurst:  # noqa: ARG001
    """Two injections: two beams along one field line."""
    return replace(burst, second_s=float(rng.uniform(15.0, 180.0)), second_height=float(rng.uniform(0.25, 0.8)))


def latitude(burst: SimulatedBurst, names: Sequence[str], rng: np.random.Generator) -> SimulatedBurst:  # noqa: ARG001
    """A source out of the ecliptic."""
    return replace(burst, latitude_deg=float(rng.uniform(-20.0, 20.0)))


def uneven(burst: SimulatedBurst, names: Sequence[str], rng: np.random.Generator) -> SimulatedBurst:
    """Times that are off smoothly along frequency, by .1 to .2 of the rise (rms), differently at each spacecraft."""
    aspects = {
        name: Aspect(lag=float(np.sqrt(2.0) * rng.uniform(0.1, 0.2)), lag_phase=float(rng.uniform(0.0, 2.0 * np.pi)))
        for name in names
    }
    return replace(burst, aspects=aspects)


def mixed(burst: SimulatedBurst, names: Sequence[str], rng: np.random.Generator) -> SimulatedBurst:
    """Several departures at once, each with its own probability."""
    for probability, depart in ((0.6, slowing), (0.6, directional), (0.4, widths), (0.25, double), (0.4, latitude)):
        if rng.random() < probability:
            burst = depart(burst, names, rng)
    return burst


Departure = Callable[[SimulatedBurst, Sequence[str], np.random.Generator], SimulatedBurst]
"""Turns a burst as :func:`draw_burst` gives it into one of a stratum, for the spacecraft of a fleet."""

DEPARTURES: dict[str, tuple[float, Departure]] = {
    "slowing": (0.2, slowing),
    "directional": (0.15, directional),
    "pairs": (0.1, pairs),
    "widths": (0.05, widths),
    "double": (0.1, double),
    "latitude": (0.05, latitude),
    "uneven": (0.0, uneven),
    "mixed": (0.1, mixed),
}
"""Strata of bursts by name, with their share of the bursts of simulated days; the rest is clean."""


def _of_a_stratum(burst: SimulatedBurst, names: Sequence[str], rng: np.random.Generator) -> SimulatedBurst:
    shares = [share for share, _ in DEPARTURES.values()]
    name = str(rng.choice(["clean", *DEPARTURES], p=[1.0 - sum(shares), *shares]))
    return burst if name == "clean" else replace(DEPARTURES[name][1](burst, names, rng), stratum=name)


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
            beam_speed_c=float(np.clip(first.beam_speed_c * rng.lognormal(0, 0.2), 0.05, 0.8)),
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
    clip = float(10.0 ** rng.uniform(1.5, 3.0)) if rng.random() < CLIPPED else np.inf
    fast_from_s = _anytime(rng) if rng.random() < MODE_CHANGE else np.inf
    return Conditions(tuple(nuisances), tuple(gaps), gain, clip=clip, fast_from_s=fast_from_s)


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

"""Isolated bursts of named strata, as the spacecraft of a fleet record them, with the truth.

A stratum says how a burst departs from the simplest one: a slowing beam, a delay that grows with the viewing angle, a
fundamental and a harmonic together, and so on. Strata and fleets are tables; a case is the same for the same stratum,
fleet and seed. Cases for choosing a method have seeds from 0 to 9999 and are asked for by number. Cases for judging it
come from :func:`judging_seed` alone, so that nobody tunes on them by accident.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from datetime import date, timedelta
from functools import cached_property, reduce

import numpy as np
import pandas as pd
import xarray as xr

from bella.exceptions import InputError
from bella.simulation.burst import (
    SimulatedBurst,
    arrival_s,
    contrast_at,
    light_arrival_s,
    mean_beam_speed_c,
    source_position_rsun,
)
from bella.simulation.day import Scene, observe_scene
from bella.simulation.instruments import Instrument, instruments
from bella.simulation.light_curves import draw_pulse_law
from bella.simulation.sky import DEPARTURES, Conditions, Departure, Gain, draw_burst
from bella.spacecraft import fleet as spacecraft_of
from bella.spectra.combination import combine_receivers
from bella.spectra.minutes import DWELL_S
from bella.units import DAY_S, FloatArray

CHOOSING_SEEDS = 10_000
FIRST_JUDGING_SEED = 1_000_000
BEFORE_S, AFTER_S = 6600.0, 12_000.0
"""So much of a spectrum lies before and after the release: the background needs hours."""

DAY = timedelta(days=1)
ENCOUNTERS = tuple(
    (day - 4 * DAY, day + 4 * DAY)
    for day in (
        date(2021, 1, 17),
        date(2021, 4, 29),
        date(2021, 8, 9),
        date(2021, 11, 21),
        date(2022, 2, 25),
        date(2022, 6, 1),
        date(2022, 9, 6),
        date(2022, 12, 11),
    )
)
"""Days about the perihelia of PSP, when it samples every 7 s."""


@dataclass(frozen=True)
class JudgingSeed:
    """Seed of a case that is for judging only; made by :func:`judging_seed`."""

    number: int

    def __post_init__(self) -> None:
        if self.number < FIRST_JUDGING_SEED:
            raise InputError(f"{self.number} is no seed for judging; take judging_seed(number), numbered from 0 on")


def judging_seed(number: int) -> JudgingSeed:
    """Seed of a case for judging a method whose numbers were chosen on other cases.

    Parameters
    ----------
    number : int
        From 0 on.

    Returns
    -------
    JudgingSeed

    Raises
    ------
    InputError
        If the number is below 0.
    """
    if number < 0:
        raise InputError(f"judging seed {number} is below 0; number the cases from 0 on")
    return JudgingSeed(FIRST_JUDGING_SEED + number)


@dataclass(frozen=True)
class Fleet:
    """Spacecraft whose spectra a case has.

    Attributes
    ----------
    datasets : mapping of str to tuple of str
        Data sets of each spacecraft.
    days : tuple of (date, date)
        Spans from which the day is drawn, ends included.
    """

    datasets: Mapping[str, tuple[str, ...]]
    days: tuple[tuple[date, date], ...]


Datasets = dict[str, tuple[str, ...]]
WIND: Datasets = {"WIND": ("WI_H1_WAV",)}
STEREO_A: Datasets = {"STEREO-A": ("STA_L3_WAV_LFR", "STA_L3_WAV_HFR")}
STEREO_B: Datasets = {"STEREO-B": ("STB_L3_WAV_LFR", "STB_L3_WAV_HFR")}
PSP: Datasets = {"PSP": ("PSP_FLD_L2_RFS_LFR", "PSP_FLD_L2_RFS_HFR")}
SOLO: Datasets = {"SOLO": ("SOLO_L3_RPW-TNR-SURV-FLUX", "SOLO_L3_RPW-HFR-SURV-FLUX")}

FLEETS = {
    "2012": Fleet(WIND | STEREO_A | STEREO_B, ((date(2012, 1, 2), date(2012, 12, 30)),)),
    "2020": Fleet(WIND | STEREO_A | PSP | SOLO, ((date(2020, 7, 1), date(2020, 12, 30)),)),
    "2021": Fleet(WIND | STEREO_A | PSP | SOLO, ((date(2021, 1, 2), date(2021, 12, 30)),)),
    "2022": Fleet(WIND | STEREO_A | PSP | SOLO, ((date(2022, 1, 2), date(2022, 12, 30)),)),
    "encounter": Fleet(WIND | STEREO_A | PSP | SOLO, ENCOUNTERS),
    "pair": Fleet(WIND | STEREO_A, ((date(2008, 6, 15), date(2012, 7, 5)), (date(2025, 2, 14), date(2026, 7, 30)))),
}
"""Fleets by name. The two spacecraft of "pair" are 30 to 120 deg apart."""


@dataclass(frozen=True)
class Drawn:
    """What a stratum draws: a burst, what is beside it, and the conditions of each spacecraft.

    Attributes
    ----------
    burst : SimulatedBurst
    others : tuple of SimulatedBurst
    conditions : mapping of str to Conditions
        By observatory; seconds count from midnight of the day of the release.
    between_s : tuple of float
        What is recorded, seconds after midnight.
    """

    burst: SimulatedBurst
    others: tuple[SimulatedBurst, ...] = ()
    conditions: Mapping[str, Conditions] = field(default_factory=dict)
    between_s: tuple[float, float] = (0.0, DAY_S)


Stratum = Callable[[Drawn, tuple[str, ...], np.random.Generator], Drawn]
"""Turns a clean burst into one of a stratum, for the spacecraft of a fleet."""


@dataclass(frozen=True)
class SimulatedCase:
    """An isolated burst in the spectra of a fleet, with the truth.

    Attributes
    ----------
    stratum, fleet : str
    seed : int
    day : datetime.date
    datasets : dict of str to tuple of str
        Data sets of each spacecraft.
    drawn : Drawn
    """

    stratum: str
    fleet: str
    seed: int
    day: date
    datasets: Datasets
    drawn: Drawn

    @cached_property
    def spectra(self) -> dict[str, xr.Dataset]:
        """One dynamic spectrum for each spacecraft, as the readers of its archive files would give it."""
        return {name: self._spectrum(name) for name in self.datasets}

    def _spectrum(self, name: str) -> xr.Dataset:
        rng = np.random.default_rng([self.seed, *f"{self.stratum}, {self.fleet}, {name}".encode()])
        receivers = [one for key in self.datasets[name] for one in instruments(key, self.day)]
        whole = reduce(combine_receivers, [_as_read(one, self.drawn, rng) for one in receivers])
        lowest_mhz = self.drawn.conditions.get(name, Conditions()).lowest_mhz
        kept = np.flatnonzero(whole["frequency"].to_numpy() >= lowest_mhz)
        return whole.isel(frequency=kept).assign_attrs(origin="simulated")

    @property
    def burst(self) -> SimulatedBurst:
        """The burst that is to be timed."""
        return self.drawn.burst

    @property
    def around_utc(self) -> np.datetime64:
        """About when the burst begins at high frequencies, as someone who looks at the spectra would say, UTC."""
        first_s = [
            arrival_s(self.burst, np.array([min(self.burst.f_high_mhz * 0.9, 8.0)]), name)[0] for name in self.datasets
        ]
        return self.burst.release_utc + np.timedelta64(round(min(first_s) / 30.0) * 30, "s")

    def truth(self, observatory: str, frequency_mhz: FloatArray) -> pd.DataFrame:
        """True arrival times at a spacecraft.

        Parameters
        ----------
        observatory : str
        frequency_mhz : numpy.ndarray, shape (N,)
            Such as the channels of its spectrum that are in the band of the burst.

        Returns
        -------
        pandas.DataFrame
            ``frequency_mhz``; ``arrival_s``, the half-rise of the true light curve, and ``light_s``, the light travel
            alone, seconds after the release; ``peak_over_background``; ``rise_s``, of the main component; and the
            position of the main component, ``x_rsun``, ``y_rsun``, ``z_rsun``, HEE.
        """
        frequency = np.asarray(frequency_mhz, dtype=np.float64)
        position = source_position_rsun(self.burst, frequency)
        return pd.DataFrame(
            {
                "frequency_mhz": frequency,
                "arrival_s": arrival_s(self.burst, frequency, observatory),
                "light_s": light_arrival_s(self.burst, frequency, observatory),
                "peak_over_background": contrast_at(self.burst, frequency, observatory),
                "rise_s": self.burst.width_factor * self.burst.pulse.rises_s(frequency),
                "x_rsun": position[:, 0],
                "y_rsun": position[:, 1],
                "z_rsun": position[:, 2],
            }
        )

    def mean_beam_speed_c(self, frequency_mhz: FloatArray) -> float:
        """Mean speed along the spiral between the highest and the lowest of some frequencies, in units of c."""
        return mean_beam_speed_c(self.burst, frequency_mhz)


def isolated_burst(stratum: str, fleet: str | date, seed: int | JudgingSeed) -> SimulatedCase:
    """One isolated burst of a stratum in the spectra of a fleet.

    Parameters
    ----------
    stratum : str
        A name of `STRATA`.
    fleet : str or datetime.date
        A name of `FLEETS`, or a day, for the spacecraft of that day.
    seed : int or JudgingSeed
        From 0 to 9999, for choosing; what :func:`judging_seed` gives, for judging.

    Returns
    -------
    SimulatedCase

    Raises
    ------
    InputError
        If a name or seed is not one of those.
    """
    if stratum not in STRATA:
        raise InputError(f"stratum {stratum!r} is not known; choose one of {', '.join(STRATA)}")
    number = _number(seed)
    rng = np.random.default_rng([number, *stratum.encode(), *str(fleet).encode()])
    datasets, day = _fleet_on_a_day(fleet, rng)
    names = tuple(datasets)
    drawn = STRATA[stratum](_clean(day, rng), names, rng)
    drawn = replace(drawn, burst=replace(drawn.burst, stratum=stratum))
    return SimulatedCase(stratum, str(fleet), number, day, datasets, drawn)


def _number(seed: int | JudgingSeed) -> int:
    if isinstance(seed, JudgingSeed):
        return seed.number
    if not 0 <= seed < CHOOSING_SEEDS:
        raise InputError(
            f"seed {seed} is not between 0 and {CHOOSING_SEEDS - 1}; for judging, use judging_seed(number)"
        )
    return seed


def _fleet_on_a_day(fleet: str | date, rng: np.random.Generator) -> tuple[dict[str, tuple[str, ...]], date]:
    if isinstance(fleet, date):
        there = set(spacecraft_of(np.datetime64(fleet, "ns") + np.timedelta64(12, "h"))["observatory"])
        everyone = WIND | STEREO_A | STEREO_B | PSP | SOLO
        return {name: datasets for name, datasets in everyone.items() if name in there}, fleet
    if fleet not in FLEETS:
        raise InputError(f"fleet {fleet!r} is not known; choose one of {', '.join(FLEETS)} or give a day")
    one = FLEETS[fleet]
    days = [first + number * DAY for first, last in one.days for number in range((last - first).days + 1)]
    return dict(one.datasets), days[int(rng.integers(len(days)))]


def _as_read(instrument: Instrument, drawn: Drawn, rng: np.random.Generator) -> xr.Dataset:
    """What is read of an instrument's file: of a visit that two minutes share only the longer part, for one."""
    burst = drawn.burst
    midnight = burst.release_utc.astype("datetime64[D]").astype("datetime64[ns]")
    conditions = drawn.conditions.get(instrument.receiver.observatory, Conditions())
    scene = Scene(midnight, (burst,), conditions, drawn.others)
    read = replace(instrument, finds_directions=False, shortest_s=0.5 * DWELL_S if instrument.averaged else 0.0)
    return observe_scene(read, scene, drawn.between_s, rng)


def _clean(day: date, rng: np.random.Generator) -> Drawn:
    """A burst that most of a fleet sees well, at a time that leaves the spectra within the day."""
    release_s = float(rng.uniform(2.5, 20.0) * 3600.0)
    burst = replace(
        draw_burst(day, rng),
        release_utc=np.datetime64(day, "ns") + np.timedelta64(int(release_s * 1e9), "ns"),
        f_low_mhz=float(np.exp(rng.uniform(np.log(0.10), np.log(0.25)))),
        f_high_mhz=float(rng.uniform(7.0, 14.0)),
        contrast=float(10.0 ** rng.uniform(1.5, 3.0)),
    )
    return Drawn(burst, between_s=(release_s - BEFORE_S, release_s + AFTER_S))


def _as_it_is(drawn: Drawn, names: tuple[str, ...], rng: np.random.Generator) -> Drawn:  # noqa: ARG001
    return drawn


def _departing(depart: Departure) -> Stratum:
    def stratum(drawn: Drawn, names: tuple[str, ...], rng: np.random.Generator) -> Drawn:
        return replace(drawn, burst=depart(drawn.burst, names, rng))

    return stratum


def _followed(drawn: Drawn, names: tuple[str, ...], rng: np.random.Generator) -> Drawn:  # noqa: ARG001
    """Another burst in the decay, from nearby."""
    later_s = float(rng.uniform(240.0, 1200.0))
    second = replace(
        drawn.burst,
        release_utc=drawn.burst.release_utc + np.timedelta64(int(later_s * 1e9), "ns"),
        phi0_deg=drawn.burst.phi0_deg + float(rng.normal(0.0, 8.0)),
        contrast=drawn.burst.contrast * float(10.0 ** rng.uniform(-0.7, 0.1)),
        beam_speed_c=float(np.clip(drawn.burst.beam_speed_c * rng.lognormal(0.0, 0.15), 0.05, 0.5)),
        pulse=draw_pulse_law(rng),
    )
    return replace(drawn, others=(second,))


def _storm(drawn: Drawn, names: tuple[str, ...], rng: np.random.Generator) -> Drawn:  # noqa: ARG001
    """Weak narrow bursts of another region every few minutes."""
    phi0_deg, every_s = float(rng.uniform(-180.0, 180.0)), float(rng.uniform(150.0, 500.0))
    start_s, stop_s = (end - BEFORE_S for end in (0.0, BEFORE_S + AFTER_S))
    weak = []
    for after_s in rng.uniform(start_s, stop_s, int((stop_s - start_s) / every_s)):
        high_mhz = float(rng.uniform(0.8, 6.0))
        weak.append(
            replace(
                drawn.burst,
                release_utc=drawn.burst.release_utc + np.timedelta64(int(after_s * 1e9), "ns"),
                phi0_deg=phi0_deg,
                f_low_mhz=0.25 * high_mhz,
                f_high_mhz=high_mhz,
                contrast=drawn.burst.contrast * float(10.0 ** rng.uniform(-2.0, -1.0)),
                pulse=draw_pulse_law(rng),
            )
        )
    return replace(drawn, others=tuple(weak))


def _far_side(drawn: Drawn, names: tuple[str, ...], rng: np.random.Generator) -> Drawn:  # noqa: ARG001
    return replace(drawn, burst=replace(drawn.burst, phi0_deg=float(rng.uniform(110.0, 250.0))))


def _gaps(drawn: Drawn, names: tuple[str, ...], rng: np.random.Generator) -> Drawn:
    """One spacecraft has a gap in the burst, all have others elsewhere."""
    release_s, hit = drawn.between_s[0] + BEFORE_S, int(rng.integers(len(names)))
    conditions = {}
    for number, name in enumerate(names):
        gaps = [float(start) for start in rng.uniform(*drawn.between_s, 2)]
        spans = [(start, start + float(rng.uniform(120.0, 1500.0))) for start in gaps]
        spans = [span for span in spans if span[1] < release_s or span[0] > release_s + 5400.0]
        if number == hit:
            start = release_s + float(rng.uniform(600.0, 1800.0))
            spans.append((start, start + float(rng.uniform(120.0, 600.0))))
        conditions[name] = Conditions(gaps_s=tuple(spans))
    return replace(drawn, conditions=conditions)


def _gain_step(drawn: Drawn, names: tuple[str, ...], rng: np.random.Generator) -> Drawn:
    conditions = {
        name: Conditions(
            gain=Gain(
                float(rng.uniform(0.0, 0.5)), float(rng.choice([-1.5, 1.5])), float(rng.uniform(*drawn.between_s))
            )
        )
        for name in names
    }
    return replace(drawn, conditions=conditions)


def _mode_change(drawn: Drawn, names: tuple[str, ...], rng: np.random.Generator) -> Drawn:
    """PSP changes from 56 s to 7 s while the burst is received."""
    moment_s = drawn.between_s[0] + BEFORE_S + float(rng.uniform(-600.0, 1500.0))
    return replace(drawn, conditions={name: Conditions(fast_from_s=moment_s) for name in names if name == "PSP"})


def _clipped(drawn: Drawn, names: tuple[str, ...], rng: np.random.Generator) -> Drawn:
    """Peaks of one or two spacecraft are flat: the receiver is saturated."""
    hit = rng.permutation(list(names))[: int(rng.integers(1, 3))]
    clip = {str(name): drawn.burst.contrast * float(rng.uniform(0.25, 0.7)) for name in hit}
    return replace(drawn, conditions={name: Conditions(clip=level) for name, level in clip.items()})


def _midnight(drawn: Drawn, names: tuple[str, ...], rng: np.random.Generator) -> Drawn:  # noqa: ARG001
    """The spectra end at midnight, while the burst is received."""
    before_s = float(rng.uniform(600.0, 2400.0))
    midnight = drawn.burst.release_utc.astype("datetime64[D]").astype("datetime64[ns]")
    release_s = DAY_S - before_s
    moved = replace(drawn.burst, release_utc=midnight + np.timedelta64(int(release_s * 1e9), "ns"))
    return replace(drawn, burst=moved, between_s=(release_s - BEFORE_S, DAY_S))


def _low_missing(drawn: Drawn, names: tuple[str, ...], rng: np.random.Generator) -> Drawn:
    """One spacecraft has no channel below 1 MHz."""
    return replace(drawn, conditions={names[int(rng.integers(len(names)))]: Conditions(lowest_mhz=1.0)})


STRATA: dict[str, Stratum] = {
    "clean": _as_it_is,
    **{name: _departing(depart) for name, (_, depart) in DEPARTURES.items()},
    "followed": _followed,
    "storm": _storm,
    "far side": _far_side,
    "gaps": _gaps,
    "gain step": _gain_step,
    "mode change": _mode_change,
    "clipped": _clipped,
    "midnight": _midnight,
    "low missing": _low_missing,
}
"""Strata by name."""

"""The joint fit of a burst: coverage, agreement with PyMC, speed, and what a wrong model does to it.

Run with ``python -m benchmarks.joint``. Three spacecraft at 1 au, at 0 and +-116.8 degrees, hear forty frequencies from
0.15 to 2 MHz with timing errors of 60, 38 and 38 s.
"""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from bella.tracks.joint_likelihood import OFFSET_SHARE
from rich.console import Console
from rich.table import Table
from scipy.stats import binomtest

from bella.arrivals import ArrivalGrid
from bella.heliosphere import DENSITY_MODELS, beam_travel_s, emission_range_rsun, slowing_travel_s, spiral_position_rsun
from bella.tracks import (
    DirectionTerms,
    Ingredients,
    JointFit,
    JointModel,
    WindPrior,
    fit_fused,
    fit_ingredients,
    fit_joint,
    sample_joint_nuts,
)
from bella.units import AU_RSUN, C_RSUN_S, FloatArray
from benchmarks.localisation import seconds

Row = tuple[str, ...]

FREQUENCY_MHZ = np.geomspace(0.15, 2.0, 40)
SIGMA_S = np.array([60.0, 38.0, 38.0])
LONGITUDES_DEG = np.array([0.0, 116.8, -116.8])
BURSTS, WRONG_BURSTS = 200, 100
MODEL = JointModel()
CHECKED = ("v_sw_km_s", "phi0_deg")
STRETCH = {"stated errors": 1.0, "errors / 4": 0.25}
LONG_DRAWS = 60_000
FIXED = {"phi0_deg": 30.0, "v_sw_km_s": 400.0}


@dataclass(frozen=True)
class Truth:
    """A burst as it was, and its arrival times without noise."""

    phi0_deg: float
    v_sw_km_s: float
    arrival_s: FloatArray


def receivers_rsun() -> FloatArray:
    """Positions of the receivers at every frequency, shape (F, 3, 3)."""
    angle = np.radians(LONGITUDES_DEG)
    place = AU_RSUN * np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
    return np.tile(place, (FREQUENCY_MHZ.size, 1, 1))


def from_the_prior(rng: np.random.Generator) -> Truth:
    """All parameters from their priors; refused only where the model itself has no probability."""
    while True:
        z = rng.standard_normal((1, len(MODEL.parameters)))
        if MODEL.allowed(z, FREQUENCY_MHZ)[0]:
            drawn = MODEL.natural(z)
            delay_s = MODEL.delay_s(z, FREQUENCY_MHZ, receivers_rsun())[0]
            return Truth(float(drawn.phi0_deg[0]), float(drawn.v_sw_km_s[0]), delay_s)


def fixed(_: np.random.Generator) -> Truth:
    """Longitude 30 degrees, wind 400 km/s, all else at the mean of its prior."""
    return along(40.0 * 0.55 / FREQUENCY_MHZ)


def along(range_rsun: FloatArray, deceleration: float = 0.0, speed_c: float = 0.15) -> Truth:
    """The same wind and longitude with the emission at given distances."""
    source = spiral_position_rsun(range_rsun, FIXED["phi0_deg"], FIXED["v_sw_km_s"])
    light_s = np.linalg.norm(source[:, None] - receivers_rsun(), axis=2) / C_RSUN_S
    if deceleration:
        travel_s = slowing_travel_s(range_rsun, speed_c, deceleration, FIXED["v_sw_km_s"])
    else:
        travel_s = beam_travel_s(range_rsun, speed_c, FIXED["v_sw_km_s"])
    return Truth(FIXED["phi0_deg"], FIXED["v_sw_km_s"], travel_s[:, None] + light_s)


def of_density(name: str) -> Callable[[np.random.Generator], Truth]:
    """Bursts whose distances follow a density model, at twice the plasma frequency."""
    range_rsun = emission_range_rsun(FREQUENCY_MHZ, DENSITY_MODELS[name], 2)
    return lambda _: along(range_rsun)


def slowing(exponent: float) -> Callable[[np.random.Generator], Truth]:
    """Bursts of a beam of 0.3 c whose speed falls as a power of the distance."""
    return lambda _: along(40.0 * 0.55 / FREQUENCY_MHZ, exponent, 0.3)


def gaussian(rng: np.random.Generator) -> FloatArray:
    """Normal deviates."""
    return rng.standard_normal((FREQUENCY_MHZ.size, SIGMA_S.size))


def heavy(rng: np.random.Generator) -> FloatArray:
    """Student's t with three degrees of freedom, of the width it is stated with: its sd is 1.7 times that."""
    return rng.standard_t(3, (FREQUENCY_MHZ.size, SIGMA_S.size))


def shared(rng: np.random.Generator) -> FloatArray:
    """Half of the variance in an offset that all channels of a receiver share."""
    return math.sqrt(0.5) * (gaussian(rng) + rng.standard_normal(SIGMA_S.size))


def as_assumed(rng: np.random.Generator) -> FloatArray:
    """Independent errors as stated, and the offsets that a fit assumes where none is declared."""
    return gaussian(rng) + OFFSET_SHARE * rng.standard_normal(SIGMA_S.size)


def one_bad(rng: np.random.Generator) -> FloatArray:
    """One arrival time is off by more than a hundred errors."""
    noise = gaussian(rng)
    noise[rng.integers(FREQUENCY_MHZ.size), rng.integers(SIGMA_S.size)] += 130.0
    return noise


def heard(truth: Truth, noise: FloatArray, stretch: float) -> ArrivalGrid:
    """Arrival times with noise."""
    sigma_s = np.tile(stretch * SIGMA_S, (FREQUENCY_MHZ.size, 1))
    return ArrivalGrid(
        FREQUENCY_MHZ,
        ("A", "B", "C"),
        truth.arrival_s + noise * sigma_s,
        sigma_s,
        receivers_rsun(),
        np.datetime64("2012-06-07T19:00", "ns"),
        "none",
    )


@dataclass(frozen=True)
class Case:
    """Bursts to simulate, and how to fit them."""

    label: str
    draw: Callable[[np.random.Generator], Truth]
    noise: Callable[[np.random.Generator], FloatArray] = gaussian
    stretch: float = 1.0
    fit: Callable[[ArrivalGrid], JointFit] = fit_joint


def coverage(case: Case, bursts: int) -> Iterator[Row]:
    """One row per parameter: median, scatter and stated error, and how often the intervals hold the truth."""
    rng = np.random.default_rng(20120607)
    truths, fits = [], []
    for _ in range(bursts):
        truths.append(case.draw(rng))
        fits.append(case.fit(heard(truths[-1], case.noise(rng), case.stretch)))
    for name in CHECKED:
        label = case.label if name == CHECKED[0] else ""
        yield label, name, *_columns(name, truths, fits), *_quality(fits)


def _columns(name: str, truths: list[Truth], fits: list[JointFit]) -> Iterator[str]:
    summary = [fit.summary[name] for fit in fits]
    truth = np.array([getattr(one, name) for one in truths])
    mean, median, sd, low, high, lowest, highest = (
        np.array([getattr(one, which) for one in summary])
        for which in ("mean", "q50", "sd", "q16", "q84", "q2_5", "q97_5")
    )
    if name == "phi0_deg":
        truth = mean + (truth - mean + 180) % 360 - 180
    yield f"{np.median(median - truth):+.1f}"
    yield f"{1.4826 * np.median(np.abs(median - truth - np.median(median - truth))):.1f}"
    yield f"{np.median(sd):.1f}"
    yield share_inside((low < truth) & (truth < high))
    yield share_inside((lowest < truth) & (truth < highest))


def share_inside(inside: np.ndarray) -> str:
    """Share of bursts whose interval holds the truth, with its own 95 per cent interval."""
    exact = binomtest(int(inside.sum()), inside.size).proportion_ci(0.95, "exact")
    return f"{inside.mean():.3f} [{exact.low:.2f}, {exact.high:.2f}]"


def _quality(fits: list[JointFit]) -> tuple[str, str]:
    share = [fit.quality.ess_share for fit in fits if fit.quality is not None]
    poor = np.mean(["poor_fit" in fit.flags for fit in fits])
    return f"{np.median(share):.2f} ({min(share):.2f})", f"{poor:.0%}"


def calibrated() -> Iterator[Row]:
    """Bursts as the model has them."""
    for label, stretch in STRETCH.items():
        for case in (
            Case("prior, no offsets, told so", from_the_prior, fit=told_of_none),
            Case("30 deg, 400 km/s, the same", fixed, fit=told_of_none),
            Case("prior, offsets as assumed", from_the_prior, as_assumed),
            Case("30 deg, 400 km/s, the same", fixed, as_assumed),
            Case("30 deg, 400 km/s, no offsets, not told", fixed),
        ):
            yield from coverage(replace(case, label=f"{case.label}, {label}", stretch=stretch), BURSTS)


def misfitted() -> Iterator[Row]:
    """Bursts as the model does not have them; then some of them fitted as they are."""
    for label, stretch in STRETCH.items():
        for case in (
            Case("Saito density", of_density("saito")),
            Case("Leblanc density", of_density("leblanc")),
            Case("beam slows as r^-0.3", slowing(0.3)),
            Case("Student's t(3) noise", fixed, heavy),
            Case("offsets, not told", fixed, shared),
            Case("offsets, told of none", fixed, shared, fit=told_of_none),
            Case("one bad arrival", fixed, one_bad),
            Case("one bad arrival, told of no offsets", fixed, one_bad, fit=told_of_none),
        ):
            yield from coverage(replace(case, label=f"{case.label}, {label}", stretch=stretch), WRONG_BURSTS)
    small = STRETCH["errors / 4"]
    for case in (
        Case("Saito density, fitted with two slopes", of_density("saito"), fit=variant(two_slope=True)),
        Case("beam slows, fitted as such", slowing(0.3), fit=variant(deceleration=True)),
        Case("offsets, told", fixed, shared, fit=told_of_offsets),
    ):
        yield from coverage(replace(case, label=f"{case.label}, errors / 4", stretch=small), WRONG_BURSTS)


def variant(*, deceleration: bool = False, two_slope: bool = False) -> Callable[[ArrivalGrid], JointFit]:
    """The fit of a variant of the model."""
    return lambda grid: fit_joint(grid, replace(MODEL, deceleration=deceleration, two_slope=two_slope))


def told_of_offsets(grid: ArrivalGrid) -> JointFit:
    """The fit with half of the variance declared as an offset of the receiver."""
    half = grid.sigma_s * math.sqrt(0.5)
    return fit_joint(replace(grid, sigma_s=half, offset_sd_s=half))


def told_of_none(grid: ArrivalGrid) -> JointFit:
    """The fit without any offset."""
    return fit_joint(grid, common_sd_s=0.0)


def with_directions(grid: ArrivalGrid) -> Ingredients:
    """Directions at every fourth frequency, 3 degrees at the two spacecraft beside the Sun, and a wind of 25 km/s."""
    rng = np.random.default_rng(int(abs(grid.arrival_s[0, 0]) * 1e6) % 2**32)
    frequency = np.repeat(FREQUENCY_MHZ[::4], 2)
    place = np.tile(receivers_rsun()[0, 1:], (FREQUENCY_MHZ[::4].size, 1))
    sight = spiral_position_rsun(40.0 * 0.55 / frequency, FIXED["phi0_deg"], FIXED["v_sw_km_s"]) - place
    longitude = np.arctan2(sight[:, 1], sight[:, 0]) + np.radians(3.0) * rng.standard_normal(frequency.size)
    latitude = np.radians(3.0) * rng.standard_normal(frequency.size)
    flat = np.stack([np.cos(longitude), np.sin(longitude)], axis=1) * np.cos(latitude)[:, None]
    towards = np.column_stack([flat, np.sin(latitude)])
    speed = FIXED["v_sw_km_s"] / (1 + 25 / FIXED["v_sw_km_s"] * rng.standard_normal())
    terms = DirectionTerms(frequency, place, towards, np.full(frequency.size, 3.0))
    return Ingredients(grid, 0.0, terms, WindPrior(speed, 25 / FIXED["v_sw_km_s"] * speed))


def combined() -> Iterator[Row]:
    """Arrival times alone, with directions, with a wind, and with both."""
    fits: dict[str, Callable[[ArrivalGrid], JointFit]] = {
        "arrival times": told_of_none,
        "and directions": lambda grid: fit_ingredients(with_directions(grid).without("wind_prior")),
        "and wind": lambda grid: fit_ingredients(with_directions(grid).without("wave_directions")),
        "and both": lambda grid: fit_ingredients(with_directions(grid)),
    }
    for label, fit in fits.items():
        yield from coverage(Case(label, fixed, fit=fit), BURSTS)


def against_sampling() -> list[Row]:
    """Differences of mean and width from long sampling of the identical posterior."""
    rng = np.random.default_rng(3)
    cases = {
        "30 deg, 400 km/s": heard(fixed(rng), gaussian(rng), 1.0),
        "the same, errors / 4": heard(fixed(rng), gaussian(rng), 0.25),
        "truth from the prior": heard(from_the_prior(rng), gaussian(rng), 1.0),
        "another": heard(from_the_prior(rng), gaussian(rng), 1.0),
    }
    return [
        (label, *_apart(fit_joint(grid, draws=LONG_DRAWS), _sampled(grid, LONG_DRAWS))) for label, grid in cases.items()
    ]


def _sampled(grid: ArrivalGrid, draws: int) -> dict[str, FloatArray]:
    return sample_joint_nuts(grid, draws=draws, seed=1)


def engines() -> list[Row]:
    """Time of a joint fit, and of PyMC on the same posterior."""
    rng = np.random.default_rng(3)
    grid = heard(fixed(rng), gaussian(rng), 1.0)
    begin = time.perf_counter()
    sampled = _sampled(grid, 4000)
    sampled_s, fitted_s = time.perf_counter() - begin, seconds(lambda: fit_joint(grid))
    fused_s = seconds(lambda: fit_fused(with_directions(grid)))
    fit = fit_joint(grid)
    effective = fit.quality.ess if fit.quality is not None else math.nan
    return [
        ("joint fit of 40 frequencies x 3 spacecraft, 4000 draws", f"{fitted_s * 1e3:.0f} ms", "200 ms"),
        ("the same by PyMC with nutpie, compilation included, two cores", f"{sampled_s:.1f} s", ""),
        ("arrival times, directions and wind, each left out once", f"{fused_s * 1e3:.0f} ms", ""),
        ("ratio PyMC / joint fit", f"{sampled_s / fitted_s:.0f}", ""),
        ("effective draws: joint fit; PyMC", f"{effective:.0f}; {sampled['effective'][0]:.0f}", ""),
    ]


def _apart(drawn: JointFit, sampled: dict[str, FloatArray]) -> Row:
    sd = {name: float(sampled[name].std()) for name in drawn.summary}
    mean = max(abs(one.mean - float(sampled[name].mean())) / sd[name] for name, one in drawn.summary.items())
    width = max(abs(one.sd / sd[name] - 1) for name, one in drawn.summary.items())
    quality = drawn.quality
    error = math.sqrt(1 / float(sampled["effective"][0]) + (1 / quality.ess if quality is not None else math.inf))
    return f"{mean:.3f}", f"{width:.3f}", f"{error:.3f}", f"{sampled['effective'][0]:.0f}"


def table(title: str, columns: tuple[str, ...], rows: list[Row]) -> Table:
    """A table whose first two columns are words."""
    printed = Table(title=title, title_justify="left")
    for i, name in enumerate(columns):
        printed.add_column(name, justify="left" if i == 0 else "right", no_wrap=i > 0)
    for row in rows:
        printed.add_row(*row)
    return printed


def main() -> None:
    """Print coverage, agreement and speed."""
    console = Console(width=150)
    columns = ("bursts", "parameter", "bias", "scatter", "stated sd", "in 68 %", "in 95 %", "ess (least)", "poor_fit")
    console.print(table(f"{BURSTS} bursts as the model has them", columns, list(calibrated())))
    console.print(table(f"{WRONG_BURSTS} bursts as it does not", columns, list(misfitted())))
    console.print(table(f"{BURSTS} bursts with more than arrival times", columns, list(combined())))
    told = ("burst", "d mean / sd", "d sd / sd", "expected by chance, each", "PyMC effective")
    console.print(
        table(f"Largest difference of six parameters from PyMC, {LONG_DRAWS} draws", told, against_sampling())
    )
    console.print(table("Speed", ("what", "measured", "target"), engines()))


if __name__ == "__main__":
    main()

"""The track of a burst: how long the fit takes beside PyMC on the same density, and how often its intervals are right.

Run with ``python -m benchmarks.tracks [--bursts 200] [--seed 5000] [--two-step 100]``. The bursts are those of
`tests.tracks.foreign`, of laws that the fit does not know: the density of Saito et al. (1977), fundamental or harmonic,
beams that keep their speed or slow down, delays that grow with the viewing angle, and errors of edges that are sums of
waves along frequency.
"""

import argparse
import time
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

import numpy as np
import pandas as pd
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table
from scipy.stats import binomtest

from bella.arrivals import POSITION, ArrivalGrid
from bella.bursts import fit_time_evolution
from bella.multilateration import localise
from bella.records import Interval, JointTrack, Parameter
from bella.tracks import fit_track
from bella.tracks.likelihood import Likelihood
from bella.tracks.model import FASTEST, LN_RANGE, NEAREST_RSUN, SLOWEST
from bella.tracks.posterior import Draws, around_the_circle, sample
from bella.tracks.spiral import track_fit
from bella.units import C_RSUN_S, FloatArray, within_half_turn_deg
from benchmarks.localisation import Row
from tests.tracks.foreign import Burst, drawn

BURSTS, JUDGING_SEED = 200, 5000
STRATA = {"constant beams": False, "slowing beams": True}
CHECKED = {"phi0_deg": "longitude, deg", "v_sw_km_s": "wind, km/s", "beam_speed_c": "beam, c"}
TWO_STEP = ("phi0_deg", "v_sw_km_s")
READ_AT, FEW_DRAWS = 200, 100
Fitted = JointTrack | Mapping[str, Parameter]
COLUMNS = ("bursts", "parameter", "in 68 %", "in 95 %", "median error", "half of the 68 % interval")

TIMED_SEED = 5004
"""A burst with one track, which chains that start there do not leave."""

REPEATS, CHAINS, TUNE, SHORT, LONG = 9, 4, 1000, 4000, 40_000


def timed(seed: int = TIMED_SEED) -> tuple[Likelihood, float]:
    """The density of the track of a burst, and the CPU time of the fit with its draws, s."""
    _, grid = drawn(seed)
    likelihood = fit_track(grid, draws=SHORT).likelihood
    spent = []
    for _ in range(REPEATS):
        begin = time.process_time()
        fit_track(grid, draws=SHORT)
        spent.append(time.process_time() - begin)
    return likelihood, float(np.median(spent))


def pymc_model(likelihood: Likelihood, middle_rad: float) -> Any:
    """The headline model for PyMC: the density of :meth:`Likelihood.log_density`, written anew."""
    pm, track, rows = _library("pymc"), likelihood.track, likelihood.seen.rows
    prior, delay = track.model.wind, track.model.delay
    mean, root = track._ln_range  # of all that decides the density, the prior of the distance alone is not written anew
    basis = track.basis(rows.frequency_mhz)
    x, y, z = rows.receiver_rsun.T
    with pm.Model() as model:
        turned = pm.Uniform("turned", -np.pi, np.pi)  # from the best longitude: chains start there
        wind, kappa, distance = pm.Normal("wind"), pm.Normal("kappa"), pm.Normal("distance", shape=mean.size)
        slowness = pm.math.clip(prior.slowness + prior.slowness_sd * wind, SLOWEST, FASTEST)
        range_rsun = pm.math.exp(pm.math.clip(basis @ (mean + root @ distance), *LN_RANGE))
        longitude = middle_rad + turned - track.model.turn_per_rsun * slowness * pm.math.maximum(range_rsun - 1, 0)
        apart = (x - range_rsun * pm.math.cos(longitude), y - range_rsun * pm.math.sin(longitude))
        sight = pm.math.sqrt(apart[0] ** 2 + apart[1] ** 2 + z**2 + NEAREST_RSUN**2)
        cosine = (apart[0] * pm.math.cos(longitude) + apart[1] * pm.math.sin(longitude)) / sight
        late = (delay.kappa + delay.kappa_sd * kappa) * rows.rise_s * (1 - cosine)
        residual = likelihood.seen.arrival_s - sight / C_RSUN_S - late
        pm.Potential("arrivals", -0.5 * residual @ likelihood.weight @ residual)
    return model


def log_density_apart(model: Any, likelihood: Likelihood, middle_rad: float, draws: Draws) -> float:
    """Largest difference of the two log densities at draws, less their mean, which is the normalisation."""
    some, winds = slice(0, 50), likelihood.track.winds
    written = model.compile_logp(vars=[*model.free_RVs[1:], *model.potentials])
    turned = np.radians(within_half_turn_deg(np.degrees(draws.phi0_rad[some] - middle_rad)))
    ours = likelihood.log_density(draws.phi0_rad[some], draws.z[some])
    theirs = [
        written(
            {
                "turned_interval__": np.log((np.pi + angle) / (np.pi - angle)),
                "wind": one[0],
                "kappa": one[winds],
                "distance": one[winds + 1 :],
            }
        )
        for angle, one in zip(turned, draws.z[some], strict=True)
    ]
    apart = ours - np.array(theirs)
    return float(np.abs(apart - apart.mean()).max())


def engines() -> list[Row]:
    """Time of the fit and of PyMC on the same density, in one run, and how far their longitudes agree."""
    nutpie, az = _library("nutpie"), _library("arviz")
    likelihood, fitted_s = timed()
    nodes = around_the_circle(likelihood)
    middle = float(nodes.phi0_rad[np.argmax(nodes.log_evidence)])
    exact = sample(likelihood, nodes, LONG, np.random.default_rng(1))
    model = pymc_model(likelihood, middle)
    apart = log_density_apart(model, likelihood, middle, exact)

    begin = time.perf_counter()
    compiled = nutpie.compile_pymc_model(model, jitter_rvs=set())
    compiled_s = time.perf_counter() - begin

    def walked(draws: int) -> Any:
        options = {"tune": TUNE, "chains": CHAINS, "cores": 2, "target_accept": 0.9, "progress_bar": False, "seed": 1}
        return nutpie.sample(compiled, draws=draws // CHAINS, **options)

    began = time.perf_counter(), time.process_time()
    walked(SHORT)
    sampled_s, cpu_s = time.perf_counter() - began[0], time.process_time() - began[1]

    longitude = np.degrees(walked(LONG).posterior["turned"].to_numpy())
    squared = (longitude - longitude.mean()) ** 2
    effective, of_squares = (float(az.ess(values)) for values in (longitude, squared))
    ours = within_half_turn_deg(np.degrees(exact.phi0_rad - middle))
    mean, sd = _moments(ours, exact.weight)
    errors = sd * np.sqrt([1 / effective + 1 / exact.effective, 0.5 / of_squares + 0.5 / exact.effective])
    return [
        (f"track of {likelihood.seen.size} arrival times with {SHORT} draws, CPU", f"{fitted_s:.2f} s", "0.5 s"),
        (
            f"the same by PyMC with nutpie, {SHORT} draws, two cores; CPU",
            f"{sampled_s:.1f} s; {cpu_s:.1f} s",
            "",
        ),
        ("its compilation", f"{compiled_s:.1f} s", ""),
        ("ratio PyMC / fit, CPU", f"{cpu_s / fitted_s:.0f}", ""),
        ("largest difference of log densities at 50 draws", f"{apart:.1e}", "1e-6"),
        (
            f"longitude less that of the best track, {LONG} draws: fit; PyMC",
            f"{mean:.3f} ± {sd:.3f}; {longitude.mean():.3f} ± {longitude.std():.3f} deg",
            "",
        ),
        (
            "mean and sd apart, in Monte Carlo errors",
            f"{(mean - longitude.mean()) / errors[0]:+.1f}, {(sd - longitude.std()) / errors[1]:+.1f}",
            "3",
        ),
        ("effective draws: fit; PyMC", f"{exact.effective:.0f}; {effective:.0f}", ""),
    ]


def _moments(values: FloatArray, weight: FloatArray) -> tuple[float, float]:
    mean = float(weight @ values)
    return mean, float(np.sqrt(weight @ (values - mean) ** 2))


def coverage(bursts: int, seed: int) -> tuple[list[tuple[str, ...]], Counter[str]]:
    """Rows of the table of coverage, and how many bursts of all have which flag."""
    rows: list[tuple[str, ...]] = []
    flags: Counter[str] = Counter()
    for place, (label, slowing) in enumerate(STRATA.items()):
        judged = [_fitted(number, slowing) for number in range(seed + place * 1000, seed + place * 1000 + bursts)]
        flags.update(flag for _, record in judged for flag in record.flags)
        rows += [_row(label if name == "phi0_deg" else "", name, judged) for name in CHECKED]
        for level, name in ((68, "phi0_68"), (95, "phi0_95")):
            inside = [_holds(getattr(record, name), burst.phi0_deg) for burst, record in judged]
            shares = (share(inside), "") if level == 68 else ("", share(inside))
            rows.append(("", f"longitude, {level} % region", *shares, "", ""))
    return rows, flags


def _fitted(seed: int, slowing: bool) -> tuple[Burst, JointTrack]:
    burst, grid = drawn(seed, slowing)
    return burst, fit_track(grid).record


def _row(label: str, name: str, judged: Sequence[tuple[Burst, Fitted]]) -> tuple[str, ...]:
    low, high, lowest, highest, middle = (
        np.array([getattr(_number(fit, name), end) for _, fit in judged], dtype=np.float64)
        for end in ("q16", "q84", "q2_5", "q97_5", "q50")
    )
    truth = np.array([getattr(burst, "mean_speed_c" if name == "beam_speed_c" else name) for burst, _ in judged])
    if name == "phi0_deg":
        truth = middle + within_half_turn_deg(truth - middle)
    held = share((low <= truth) & (truth <= high)), share((lowest <= truth) & (truth <= highest))
    error, width = np.nanmedian(np.abs(middle - truth)), np.nanmedian(0.5 * (high - low))
    return label, CHECKED[name], *held, f"{error:.2g}", f"{width:.2g}"


def _number(fit: Fitted, name: str) -> Parameter:
    number: Parameter = fit[name] if isinstance(fit, Mapping) else getattr(fit, name)
    return number


def in_two_steps(bursts: int, seed: int) -> list[tuple[str, ...]]:
    """Rows of the two-step fit as published: 200 positions on smooth curves t(f), and a line through them.

    Its errors are those of independent points (Canizares et al. 2024, doi:10.1051/0004-6361/202347747).
    """
    judged = []
    for number in progress(range(seed, seed + bursts), "two-step"):
        burst, grid = drawn(number)
        line = track_fit(localise(_curves(grid), draws=FEW_DRAWS))["two_step"]
        judged.append((burst, {name: Parameter.model_validate(line[name]) for name in TWO_STEP}))
    return [_row("two-step" if name == "phi0_deg" else "", name, judged) for name in TWO_STEP]


def _curves(grid: ArrivalGrid) -> pd.DataFrame:
    """Arrival table of the curve t(f) of each spacecraft, read at many frequencies."""
    frequency_mhz = np.geomspace(grid.frequency_mhz[0], grid.frequency_mhz[-1], READ_AT)
    parts = []
    for column, name in enumerate(grid.observatories):
        curve = fit_time_evolution(grid.frequency_mhz, grid.arrival_s[:, column], grid.sigma_s[:, column])
        late = np.rint(curve.arrival_s(frequency_mhz) * 1e9).astype("timedelta64[ns]")
        place = dict(zip(POSITION, grid.receiver_rsun[0, column], strict=True))
        times = {"frequency_mhz": frequency_mhz, "arrival_utc": grid.reference_utc + late}
        parts.append(
            pd.DataFrame(times).assign(observatory=name, sigma_s=grid.sigma_s[0, column], edge="none", **place)
        )
    return pd.concat(parts, ignore_index=True)


def _holds(region: tuple[Interval, ...], longitude_deg: float) -> bool:
    return any((longitude_deg - part.low) % 360 <= part.high - part.low for part in region)


def share(inside: Any) -> str:
    """Share of bursts whose interval holds the truth, with the 95 % interval of Wilson."""
    count = int(np.sum(inside))
    wilson = binomtest(count, len(inside)).proportion_ci(0.95, "wilson")
    return f"{count / len(inside):.2f} ({wilson.low:.2f}-{wilson.high:.2f})"


def _library(name: str) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)
        return import_module(name)


def main() -> None:
    """Print speed, agreement with PyMC, and coverage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bursts", type=int, default=BURSTS)
    parser.add_argument("--seed", type=int, default=JUDGING_SEED)
    parser.add_argument("--two-step", type=int, default=0, help="bursts to fit in two steps as well")
    asked = parser.parse_args()
    speed, held = Table(title="One track"), Table(title=f"{asked.bursts} bursts each")
    for name in ("what", "measured", "target"):
        speed.add_column(name)
    for name in COLUMNS:
        held.add_column(name)
    for one in engines():
        speed.add_row(*one)
    rows, flags = coverage(asked.bursts, asked.seed)
    for row in (*rows, *(in_two_steps(asked.two_step, asked.seed) if asked.two_step else ())):
        held.add_row(*row)
    console = Console(width=150)
    console.print(speed, held)
    console.print("Flags: " + ", ".join(f"{name} {count}" for name, count in flags.most_common()))


if __name__ == "__main__":
    main()

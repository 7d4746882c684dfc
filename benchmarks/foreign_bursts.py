"""Bursts of pulses, delays and beams that are in no other part of the house, through the commands, against their truth.

Run with ``python -m benchmarks.foreign_bursts [--bursts 10] [--seed 1] [--fleet 2021]``. Spectra are written as netCDF
and go through ``bella arrivals``, ``bella localise`` and ``bella fit-track`` with their defaults; only positions of
spacecraft come from the package. Pulses are Gumbel, log-normal or Weibull; delays grow with the cosine, the sine or the
tangent of the viewing angle, or are the same number of seconds at all frequencies; beams are constant or lose speed
exponentially with time. Differences of arrival times are those of the table, from 0.3 MHz on.
A last table has arrival times with errors of 5 s and one clock that is 10 s late.
"""

import argparse
import itertools
import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr
from rich.console import Console
from rich.progress import track as progress
from rich.table import Table
from typer.testing import CliRunner

from bella.cli import app
from bella.spacecraft import position_hee
from bella.units import FloatArray

LIGHT_RSUN_S = 299_792.458 / 695_700.0
TURN_RAD_S = 2 * np.pi / (25.38 * 86_400.0)
WIND_AND_STEREO_A = {"WIND": (60.0, True), "STEREO-A": (38.05, False)}
FLEETS = {
    "2012": ("2012-06-07T12:00:00", WIND_AND_STEREO_A | {"STEREO-B": (38.05, False)}),
    "2020": ("2020-10-11T06:00:00", WIND_AND_STEREO_A | {"SOLO": (17.0, False), "PSP": (7.0, True)}),
    "2021": ("2021-10-09T06:00:00", WIND_AND_STEREO_A | {"SOLO": (17.0, False), "PSP": (7.0, True)}),
    "2022": ("2022-03-02T06:00:00", WIND_AND_STEREO_A | {"SOLO": (17.0, False)}),
}
"""When bursts begin, and of each receiver the cadence, s, and whether samples are means over it."""
CHANNELS_MHZ = np.geomspace(0.08, 13.5, 70)
LOWEST_MHZ = 0.3
INSIDE = {68: 2.2789, 95: 5.9915}
LOST = 11.829
"""Chi-squared of two degrees of freedom at 68 %, 95 % and 3 standard deviations."""

Angle = FloatArray
DELAYS: dict[str, Callable[[Angle, FloatArray], FloatArray]] = {
    "none": lambda angle, rise_s: 0 * angle * rise_s,
    "cosine": lambda angle, rise_s: rise_s * (1 - np.cos(angle)),
    "sine squared": lambda angle, rise_s: rise_s * np.sin(angle) ** 2,
    "tangent": lambda angle, rise_s: 0.6 * rise_s * np.minimum(np.tan(angle / 2), 3.0),
    "seconds": lambda angle, rise_s: 30.0 * (1 - np.cos(angle)) + 0 * rise_s,
}
"""Delay of an edge for a size of one, s, by the angle between radius and line of sight and the half width of the rise;
sizes are 0.1 to 0.3."""
PULSES: dict[str, Callable[[FloatArray], FloatArray]] = {
    "gumbel": lambda x: np.exp(-x - np.exp(np.clip(-x, None, 50))),
    "log-normal": lambda x: np.where(x > -4, np.exp(-2.2 * np.log(np.maximum(x + 4, 1e-9) / 4) ** 2 * 4), 0.0),
    "weibull": lambda x: np.where(x > -1, (1 - np.exp(-(np.maximum(x + 1, 0) ** 2))) * np.exp(-(x + 1) / 2.5), 0.0),
}
STRATA = {
    "constant": ("none", False),
    "slowing": ("none", True),
    "cosine": ("cosine", False),
    "sine squared": ("sine squared", False),
    "tangent": ("tangent", False),
    "seconds": ("seconds", False),
}
"""Delay of each stratum, and whether its beams slow down."""


@dataclass(frozen=True)
class Burst:
    """One burst with its truth."""

    release_utc: np.datetime64
    phi0_deg: float
    v_sw_km_s: float
    beam_c: float
    delay: str
    size: float
    slows: bool
    pulse: str
    rise_one_mhz_s: float
    density: float
    harmonic: int

    def range_rsun(self, frequency_mhz: FloatArray) -> FloatArray:
        """Distance by the density of Vrsnak et al. (2004, doi:10.1051/0004-6361:20047169)."""
        r = np.geomspace(1.2, 600, 4000)
        density_cm3 = 1e8 * self.density * (15.45 * r**-16.0 + 3.165 * r**-6.0 + r**-4.0 + 0.0033 * r**-2.0)
        emitted = self.harmonic * 8.98e-3 * np.sqrt(density_cm3)
        return np.asarray(np.exp(np.interp(np.log(frequency_mhz), np.log(emitted[::-1]), np.log(r[::-1]))))

    def position_rsun(self, frequency_mhz: FloatArray) -> FloatArray:
        """HEE, shape (F, 3)."""
        r = self.range_rsun(frequency_mhz)
        angle = np.radians(self.phi0_deg) - TURN_RAD_S * (r - 1) * 695_700.0 / self.v_sw_km_s
        return np.stack([r * np.cos(angle), r * np.sin(angle), 0 * r], axis=1)

    def emission_s(self, frequency_mhz: FloatArray) -> FloatArray:
        """After the release."""
        r = np.linspace(1, 600, 6000)
        per_rsun = np.hypot(1, r * TURN_RAD_S * 695_700.0 / self.v_sw_km_s)
        path = np.interp(self.range_rsun(frequency_mhz), r, np.concatenate([[0], np.cumsum(per_rsun[1:] * np.diff(r))]))
        time_s = path / (self.beam_c * LIGHT_RSUN_S)
        if not self.slows:
            return np.asarray(time_s)
        longest_s = 3.0 * 150.0 / (self.beam_c * LIGHT_RSUN_S)
        return np.asarray(-longest_s * np.log(np.maximum(1 - time_s / longest_s, 0.05)))

    def rise_s(self, frequency_mhz: FloatArray) -> FloatArray:
        """From half of the maximum to the maximum."""
        return np.asarray(self.rise_one_mhz_s * frequency_mhz**-0.85)

    def edge_s(self, frequency_mhz: FloatArray, receiver: FloatArray) -> FloatArray:
        """When the curve reaches half of its maximum at a receiver, after the release."""
        source = self.position_rsun(frequency_mhz)
        sight = receiver - source
        distance = np.linalg.norm(sight, axis=1)
        cosine = (sight * source).sum(axis=1) / distance / np.linalg.norm(source, axis=1)
        late = self.size * DELAYS[self.delay](np.arccos(np.clip(cosine, -1, 1)), self.rise_s(frequency_mhz))
        return np.asarray(self.emission_s(frequency_mhz) + distance / LIGHT_RSUN_S + late)


def burst_of(stratum: str, rng: np.random.Generator, fleet: str = "2012") -> Burst:
    """One burst of a stratum."""
    delay, slows = STRATA[stratum]
    return Burst(
        release_utc=np.datetime64(FLEETS[fleet][0], "ns") + np.timedelta64(int(rng.uniform(0, 3600) * 1e9), "ns"),
        phi0_deg=rng.uniform(-180, 180),
        v_sw_km_s=rng.uniform(320, 620),
        beam_c=rng.uniform(0.1, 0.28),
        delay=delay,
        size=0.0 if delay == "none" else rng.uniform(0.1, 0.3),
        slows=slows,
        pulse=str(rng.choice(list(PULSES))),
        rise_one_mhz_s=rng.uniform(22, 45),
        density=np.exp(rng.normal(0.3, 0.3)),
        harmonic=int(rng.choice([1, 2])),
    )


def spectrum_of(
    burst: Burst, observatory: str, cadence_s: float, is_mean: bool, rng: np.random.Generator
) -> xr.Dataset:
    """What one receiver records: three hours of background, noise and the burst."""
    start_s = -3600.0 - rng.uniform(0, cadence_s)
    time_s = np.arange(start_s, start_s + 4 * 3600, cadence_s)
    receiver = position_hee(observatory, burst.release_utc, burst.release_utc)[0]
    x = np.linspace(-8, 60, 20_000)
    pulse = PULSES[burst.pulse](x)
    top = int(pulse.argmax())
    half = float(np.interp(0.5 * pulse[top], pulse[: top + 1], x[: top + 1]))
    scale_s = burst.rise_s(CHANNELS_MHZ) / (x[top] - half)
    inside_s = (np.arange(12) + 0.5) / 12 * cadence_s - cadence_s / 2 if is_mean else np.zeros(1)
    since_s = time_s[:, None, None] + inside_s - burst.edge_s(CHANNELS_MHZ, receiver)[:, None]
    curve = np.interp(half + since_s / scale_s[:, None], x, pulse / pulse[top], left=0.0, right=0.0).mean(axis=2)
    contrast = 120 * np.exp(-0.5 * (np.log(CHANNELS_MHZ / 0.7) / 1.1) ** 2) * rng.uniform(0.5, 1.5)
    background = 1e-14 * (1 + CHANNELS_MHZ**-1.5)
    flux = (1 + contrast * curve) * (1 + 0.03 * rng.standard_normal(curve.shape))
    return xr.Dataset(
        {"intensity": (("time", "frequency"), (background * flux).astype(np.float32))},
        coords={
            "time": burst.release_utc + (time_s * 1e9).astype("timedelta64[ns]"),
            "frequency": CHANNELS_MHZ,
        },
        attrs={
            "observatory": observatory,
            "receiver": "made",
            "quantity": "psd_v2_hz",
            "integration_s": cadence_s if is_mean else 0.05,
            "origin": "simulated",
        },
    )


def run(*arguments: str) -> None:
    """One command of the package; its refusal is an error."""
    outcome = CliRunner().invoke(app, list(arguments))
    if outcome.exit_code:
        raise RuntimeError(str(outcome.exception))


@dataclass(frozen=True)
class Judged:
    """One burst against its truth; `why` says why it has no answer."""

    why: str = ""
    away: tuple[float, ...] = ()
    inside: tuple[tuple[float, float], ...] = ()
    error_deg: float = float("nan")
    flags: tuple[str, ...] = ()
    off_s: FloatArray = field(default_factory=lambda: np.empty(0))
    pull: FloatArray = field(default_factory=lambda: np.empty(0))


def differences(burst: Burst, table: Path) -> tuple[FloatArray, FloatArray]:
    """Errors of the differences of the arrival times of two spacecraft, s, and over what is stated."""
    rows = pd.read_csv(table, comment="#", parse_dates=["arrival_utc"])
    rows = rows[rows["frequency_mhz"] >= LOWEST_MHZ]
    stated = [rows[name] for name in ("sigma_s", "shape_sd_s", "offset_sd_s", "delay_sd_s") if name in rows]
    rows["variance_s2"] = sum(one**2 for one in stated)
    since_s = (rows["arrival_utc"].dt.tz_localize(None) - pd.Timestamp(burst.release_utc)) / pd.Timedelta(1, "s")
    for name, its in rows.groupby("observatory"):
        receiver = position_hee(str(name), burst.release_utc, burst.release_utc)[0]
        rows.loc[its.index, "off_s"] = since_s[its.index] - burst.edge_s(its["frequency_mhz"].to_numpy(), receiver)
    rows = rows.set_index(["frequency_mhz", "observatory"])
    off, variance = (rows[name].to_xarray().to_pandas() for name in ("off_s", "variance_s2"))
    pairs = list(itertools.combinations(sorted(off.columns), 2))
    apart = np.concatenate([off[one] - off[other] for one, other in pairs])
    sd_s = np.concatenate([np.sqrt(variance[one] + variance[other]) for one, other in pairs])
    known = np.isfinite(apart)
    return apart[known], apart[known] / sd_s[known]


def judged(burst: Burst, fleet: str, folder: Path, rng: np.random.Generator) -> Judged:
    """Take a burst through the commands."""
    files = []
    for name, (cadence_s, is_mean) in FLEETS[fleet][1].items():
        files.append(str(folder / f"{name}.nc"))
        spectrum_of(burst, name, cadence_s, is_mean, rng).to_netcdf(files[-1], engine="h5netcdf")
    table, places, track = (str(folder / name) for name in ("arrivals.csv", "places.csv", "track.json"))
    around = burst.release_utc + np.timedelta64(int(burst.emission_s(np.array([1.0]))[0] + 500), "s")
    try:
        run("arrivals", *files, "--around", f"{np.datetime_as_string(around, unit='s')}Z", "--output", table)
        run("localise", table, "--output", places)
        run("fit-track", table, "--output", track)
    except RuntimeError as error:
        return Judged(why=str(error))
    found = pd.read_csv(places, comment="#")
    joint = json.loads(Path(track).read_text(encoding="utf-8"))["joint"]
    apart = found[["x_rsun", "y_rsun"]].to_numpy() - burst.position_rsun(found["frequency_mhz"].to_numpy())[:, :2]
    xx, xy, yy = (found[f"cov_{pair}_rsun2"].to_numpy() for pair in ("xx", "xy", "yy"))
    away = (yy * apart[:, 0] ** 2 - 2 * xy * apart[:, 0] * apart[:, 1] + xx * apart[:, 1] ** 2) / (xx * yy - xy**2)
    if joint.get("tier") == "preliminary" or joint["phi0_deg"].get("q50") is None:
        return Judged(why="preliminary or no track")
    turn = (burst.phi0_deg - joint["phi0_deg"]["q50"] + 180) % 360 - 180
    truths = (joint["phi0_deg"]["q50"] + turn, burst.v_sw_km_s)
    inside = tuple(
        (float(one["q16"] <= truth <= one["q84"]), float(one["q2_5"] <= truth <= one["q97_5"]))
        for one, truth in zip((joint["phi0_deg"], joint["v_sw_km_s"]), truths, strict=True)
    )
    return Judged("", tuple(away), inside, abs(turn), tuple(joint["flags"]), *differences(burst, Path(table)))


def late_clock(receivers: int, late_s: float, rng: np.random.Generator, folder: Path) -> tuple[FloatArray, str]:
    """Squared distances of positions whose arrival times have errors of 5 s and one late clock, and the clock named."""
    burst = burst_of("constant", rng)
    frequency_mhz = np.geomspace(0.2, 1.8, 8)
    angle = np.array([0.0, 116.0, -116.0, 50.0, -50.0])[:receivers] * np.pi / 180
    place = np.array([215.0, 207.0, 218.0, 120.0, 170.0])[:receivers] * np.stack(
        [np.cos(angle), np.sin(angle), 0 * angle]
    )
    late = rng.integers(receivers)
    rows = []
    for which, position in enumerate(place.T):
        times_s = burst.edge_s(frequency_mhz, position) + 5 * rng.standard_normal(8) + late_s * (which == late)
        rows += [
            (
                f"R{which}",
                mhz,
                f"{burst.release_utc + np.timedelta64(round(time_s * 1e9), 'ns')}Z",
                5.0,
                "made",
                *position,
            )
            for mhz, time_s in zip(frequency_mhz, times_s, strict=True)
        ]
    columns = ["observatory", "frequency_mhz", "arrival_utc", "sigma_s", "edge", "x_rsun", "y_rsun", "z_rsun"]
    table, places = folder / "late.csv", folder / "late_places.csv"
    pd.DataFrame(rows, columns=columns).to_csv(table, index=False)
    run("localise", str(table), "--output", str(places), "--kappa", "none")
    found = pd.read_csv(places, comment="#")
    apart = found[["x_rsun", "y_rsun"]].to_numpy() - burst.position_rsun(found["frequency_mhz"].to_numpy())[:, :2]
    xx, xy, yy = (found[f"cov_{pair}_rsun2"].to_numpy() for pair in ("xx", "xy", "yy"))
    away = (yy * apart[:, 0] ** 2 - 2 * xy * apart[:, 0] * apart[:, 1] + xx * apart[:, 1] ** 2) / (xx * yy - xy**2)
    flagged = "clock_offset" in str(found["flags"].iloc[0])
    return away, "flagged" if flagged else ""


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bursts", type=int, default=10, help="per stratum")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--strata", nargs="*", default=list(STRATA), choices=list(STRATA))
    parser.add_argument("--fleet", nargs="*", default=["2012"], choices=list(FLEETS))
    chosen = parser.parse_args()
    console = Console(width=150)
    bursts = Table(
        *("stratum", "answers", "positions 68 / 95 %", "lost", "longitude 68 / 95 %", "error, deg", "wind 68 / 95 %"),
        *("differences: bias, rms, s", "pull"),
    )
    with tempfile.TemporaryDirectory() as folder:
        for number, stratum in enumerate(STRATA):
            if stratum not in chosen.strata:
                continue
            tries = []
            for fleet in chosen.fleet:
                rng = np.random.default_rng([chosen.seed, number, int(fleet)])
                asked = progress(range(chosen.bursts), f"{stratum}, {fleet}", console=Console(stderr=True))
                tries += [judged(burst_of(stratum, rng, fleet), fleet, Path(folder), rng) for _ in asked]
            bursts.add_row(stratum, *summary(tries))
            console.print(stratum, *summary(tries), sep=" | ")
            for one in tries:
                console.print(stratum, one.why or f"{one.error_deg:.1f} deg", ", ".join(one.flags))
        clocks = Table("receivers", "late by", "positions 68 / 95 %", "flagged")
        for receivers in (3, 4, 5):
            for late_s in (0.0, 10.0):
                rng = np.random.default_rng([chosen.seed, 99, receivers, int(late_s)])
                tried = [late_clock(receivers, late_s, rng, Path(folder)) for _ in range(3 * chosen.bursts)]
                shares = " / ".join(
                    f"{np.mean([(away < limit).mean() for away, _ in tried]):.2f}" for limit in INSIDE.values()
                )
                named = sum(bool(flag) for _, flag in tried)
                clocks.add_row(str(receivers), f"{late_s:g} s", shares, f"{named} of {len(tried)}")
    console.print(bursts, clocks)


def summary(tries: list[Judged]) -> list[str]:
    """One row of the table."""
    answers = [one for one in tries if not one.why]
    if not answers:
        return [f"0 of {len(tries)}", *7 * [""]]
    away = [np.array(one.away) for one in answers]
    off_s, pull = (np.concatenate([getattr(one, name) for one in answers]) for name in ("off_s", "pull"))

    def pair(number: int) -> str:
        return " / ".join(f"{np.mean([one.inside[number][level] for one in answers]):.2f}" for level in (0, 1))

    return [
        f"{len(answers)} of {len(tries)}",
        " / ".join(f"{np.mean([(one < limit).mean() for one in away]):.2f}" for limit in INSIDE.values()),
        f"{np.mean([(one > LOST).mean() > 0.5 for one in away]):.2f}",
        pair(0),
        f"{np.median([one.error_deg for one in answers]):.1f}",
        pair(1),
        f"{off_s.mean():+.2f}, {np.sqrt((off_s**2).mean()):.2f}",
        f"{np.sqrt((pull**2).mean()):.2f}",
    ]


if __name__ == "__main__":
    main()

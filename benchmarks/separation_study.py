"""The simulation study of Canizares et al. (2024) again: ``python -m benchmarks.separation_study [--figure FILE]``.

Three spacecraft at 1 au, at 0 and +- a separation, hear a burst on a Parker spiral. How well is it placed, as a
function of the separation; and what does a simulation say about the errors, depending on the noise put into it?
"""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from bella.heliosphere import PAPER_FIGURES_ROTATION_D, spiral_longitude_deg
from bella.multilateration.cells import divide
from bella.multilateration.posterior import moments_of
from bella.multilateration.priors import Priors
from bella.multilateration.problems import Problems, problems_of
from bella.multilateration.uncertainty_map import Receivers, exact_covariance, noise_free_arrivals
from bella.units import AU_RSUN, FloatArray

PRIORS = Priors()
RANGES_RSUN = (10.0, 150.0)
PHI0_DEG, V_SW_KM_S = 30.0, 400.0
SEPARATIONS_DEG = np.arange(10.0, 181.0, 2.5)
SHOWN_DEG = (10, 30, 45, 60, 90, 115, 150, 165, 170, 180)
SIGMAS_S = (60.0, 30.0)
THRESHOLD_RSUN = 25.0
PUBLISHED_DEG = (45.0, 165.0)
EVENT = Receivers(("WIND", "STEREO-A", "STEREO-B"), np.zeros((3, 3)), np.array([60.0, 38.05, 38.05]))
BURSTS = 500
# Squared distance, in posterior standard deviations, that holds 68 and 95 % of a Gaussian in the plane
LEVELS = {0.68: -2 * np.log(1 - 0.68), 0.95: -2 * np.log(1 - 0.95)}


def on_spiral(count: int) -> FloatArray:
    """Sources along the spiral of the paper, shape (count, 2), solar radii."""
    radius = np.linspace(*RANGES_RSUN, count)
    angle = np.radians(spiral_longitude_deg(radius, PHI0_DEG, V_SW_KM_S, PAPER_FIGURES_ROTATION_D))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def receivers_at(separation_deg: float, sigma_s: FloatArray) -> Receivers:
    """Three receivers at 1 au, at 0 and +- a separation."""
    angle = np.radians([0.0, separation_deg, -separation_deg])
    positions = AU_RSUN * np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
    return replace(EVENT, position_rsun=positions, sigma_s=sigma_s)


def sweep(sigma_s: float, separations_deg: FloatArray = SEPARATIONS_DEG) -> FloatArray:
    """Mean sd_x and sd_y along the spiral at each separation, exact posterior of noise-free data, shape (S, 2)."""
    sources = on_spiral(15)
    rows = [exact_covariance(sources, receivers_at(one, np.full(3, sigma_s)), PRIORS) for one in separations_deg]
    return np.array([np.sqrt(np.einsum("nii->ni", row)).mean(axis=0) for row in rows])


def band(sds: FloatArray, threshold: float) -> tuple[float, float]:
    """Separations between which both standard deviations are below a threshold, degrees; NaN where there are none."""
    worst = sds.max(axis=1)
    good = np.flatnonzero(worst <= threshold)
    if good.size == 0:
        return np.nan, np.nan
    return _crossing(worst, good[0] - 1, threshold), _crossing(worst, good[-1], threshold)


def _crossing(worst: FloatArray, left: int, threshold: float) -> float:
    """Separation after the one of index `left` at which the threshold is crossed."""
    order = np.argsort(worst[left : left + 2])
    pair = worst[left : left + 2][order], SEPARATIONS_DEG[left : left + 2][order]
    return float(np.interp(threshold, *pair))


def implied_threshold(sds: FloatArray) -> float:
    """Larger standard deviation at the worse end of the published band, solar radii."""
    return float(max(np.interp(end, SEPARATIONS_DEG, sds.max(axis=1)) for end in PUBLISHED_DEG))


def coverage(assumed_s: FloatArray, noise_s: FloatArray, seed: int = 1) -> dict[float, float]:
    """Share of bursts whose true position is in the 68 and in the 95 % ellipse of the exact posterior."""
    sources, fleet = on_spiral(BURSTS), receivers_at(116.0, assumed_s)
    clean = noise_free_arrivals(sources, fleet)
    noise = np.random.default_rng(seed).standard_normal(clean.arrival_s.shape) * noise_s
    problems = problems_of(replace(clean, arrival_s=clean.arrival_s + noise), PRIORS, 2)
    distance = np.concatenate(
        [_distance(problems.at(slice(i, i + 25)), sources[i : i + 25]) for i in range(0, BURSTS, 25)]
    )
    return {level: float((distance < limit).mean()) for level, limit in LEVELS.items()}


def _distance(problems: Problems, sources: FloatArray) -> FloatArray:
    solved = moments_of(problems, divide(problems))
    away = sources - solved.mean
    return np.asarray(np.einsum("bi,bij,bj->b", away, np.linalg.inv(solved.covariance), away))


def noises() -> list[tuple[str, FloatArray, FloatArray]]:
    """What is simulated: name, timing error assumed, and noise put in, s."""
    cadence = EVENT.sigma_s
    flight_s = noise_free_arrivals(on_spiral(BURSTS), receivers_at(116.0, cadence)).arrival_s
    half = np.full(3, 30.0)
    return [
        ("none", cadence, np.zeros(3)),
        ("0.5 % of the flight time", cadence, 0.005 * flight_s),
        ("cadence / sqrt(12), as rounding", cadence, cadence / np.sqrt(12)),
        ("as large as assumed", cadence, cadence),
        ("the cadence, 30 s assumed", half, cadence),
    ]


def table_of_separations(swept: dict[float, FloatArray]) -> Table:
    """Mean standard deviations by separation and timing error."""
    table = Table(title="Mean sd_x / sd_y along the spiral (solar radii)")
    for name in ("separation", *(f"{sigma:g} s" for sigma in swept)):
        table.add_column(name, justify="right")
    for separation in SHOWN_DEG:
        row = int(np.argmin(np.abs(SEPARATIONS_DEG - separation)))
        table.add_row(f"{separation}", *(f"{sds[row, 0]:.1f} / {sds[row, 1]:.1f}" for sds in swept.values()))
    return table


def table_of_bands(swept: dict[float, FloatArray]) -> Table:
    """Band of separations by threshold, and the threshold that the published band stands for."""
    table = Table(title="Separations at which both standard deviations are below a threshold (degrees)")
    thresholds = (15.0, THRESHOLD_RSUN, 35.0, 44.0, 50.0)
    for name in ("timing error", *(f"{one:g} Rsun" for one in thresholds), "threshold of 45 to 165 deg"):
        table.add_column(name, justify="right")
    for sigma, sds in swept.items():
        bands = ["{:.0f} to {:.0f}".format(*band(sds, one)).replace("nan to nan", "none") for one in thresholds]
        table.add_row(f"{sigma:g} s", *bands, f"{implied_threshold(sds):.0f} Rsun")
    return table


def table_of_coverage() -> Table:
    """How often the truth is inside, by what the noise was."""
    table = Table(title=f"Truth inside the ellipse, {BURSTS} bursts, separation 116 deg, cadences 60 / 38.05 / 38.05 s")
    for name in ("noise of the simulation", *(f"{level:.0%}" for level in LEVELS)):
        table.add_column(name, justify="left" if name.startswith("noise") else "right")
    for name, assumed, noise in noises():
        table.add_row(name, *(f"{share:.3f}" for share in coverage(assumed, noise).values()))
    return table


def write_figure(path: Path, swept: dict[float, FloatArray]) -> None:
    """Standard deviations against the separation."""
    figure = Figure(figsize=(6.4, 3.6), layout="constrained")
    axes = figure.add_subplot()
    for (sigma, sds), style in zip(swept.items(), ("-", "--"), strict=True):
        for axis, colour in enumerate(("#1f7fc1", "#d95f02")):
            label = f"sd {'xy'[axis]}, timing error {sigma:g} s"
            axes.plot(SEPARATIONS_DEG, sds[:, axis], style, color=colour, label=label)
    axes.axvspan(*PUBLISHED_DEG, color="0.92", zorder=0, label="published band")
    axes.axhline(THRESHOLD_RSUN, color="0.5", lw=0.8)
    axes.axhline(PRIORS.tau_rsun, color="0.5", lw=0.8, ls=":")
    axes.annotate("25", (181, THRESHOLD_RSUN), fontsize=8, color="0.4", va="center", annotation_clip=False)
    axes.annotate("prior", (181, PRIORS.tau_rsun), fontsize=8, color="0.4", va="center", annotation_clip=False)
    axes.set_xlabel("Separation from Earth of the two outer spacecraft (deg)")
    axes.set_ylabel(r"Mean along the burst ($R_\odot$)")
    axes.set_xlim(10, 180)
    axes.set_ylim(0, 110)
    axes.legend(fontsize=7, ncols=2, loc="upper center", framealpha=0.9)
    figure.savefig(path, dpi=110, metadata={"Software": "BELLA service"})


def main() -> None:
    """Print the tables and, where asked for, write the figure."""
    parser = argparse.ArgumentParser(description="Separation of the spacecraft, and what noise a simulation needs.")
    parser.add_argument("--figure", type=Path, help="PNG file to write")
    figure = parser.parse_args().figure
    swept = {sigma: sweep(sigma) for sigma in SIGMAS_S}
    console = Console(width=120)
    for table in (table_of_separations(swept), table_of_bands(swept), table_of_coverage()):
        console.print(table)
    if figure is not None:
        write_figure(figure, swept)


if __name__ == "__main__":
    main()

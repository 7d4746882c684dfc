"""Receivers, sources and noise-free arrival times of the reference cases, and the posterior by brute force."""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import xarray as xr

from bella.arrivals import NUISANCE, POSITION, ArrivalGrid
from bella.multilateration import localise
from bella.multilateration.cells import TOLERANCE, divide
from bella.multilateration.posterior import Moments, moments_of
from bella.multilateration.priors import PRESETS, Noise, Preset, Priors
from bella.multilateration.problems import GAUSSIAN, problems_of
from bella.multilateration.regions import Region, regions_of
from bella.units import AU_RSUN, C_RSUN_S, R_SUN_KM

REFERENCE_UTC = np.datetime64("2012-06-07T19:00:00", "ns")
NARROW, WIDE = Priors(), Priors(v_sd_c=0.1)
PLAIN = Preset("plain", NARROW, "table")
ROBUST, FREE, BELOW_C = (
    Preset("robust", NARROW, "table", noise=PRESETS["robust"].noise),
    Preset("free-speed", WIDE, "table"),
    Preset("subluminal", Priors(v_sd_c=0.1, v_max_c=1.0), "table"),
)


def polar(range_rsun: float, longitude_deg: float) -> np.ndarray:
    angle = np.radians(longitude_deg)
    return range_rsun * np.array([np.cos(angle), np.sin(angle), 0.0])


EVENT = np.stack([polar(1.004 * AU_RSUN, 0), polar(0.958 * AU_RSUN, 116), polar(1.014 * AU_RSUN, -116)])
FOUR = np.vstack([EVENT, polar(0.5 * AU_RSUN, 40)])
FIVE = np.vstack([FOUR, polar(0.8 * AU_RSUN, -60)])
CADENCE_S = np.array([60.0, 38.0, 38.0])


def spread(separation_deg: float) -> np.ndarray:
    """Three receivers at 1 au, at 0 and +- a separation."""
    return np.stack([polar(AU_RSUN, longitude) for longitude in (0.0, separation_deg, -separation_deg)])


def on_spiral(range_rsun: float) -> np.ndarray:
    """Source on the reference spiral: 30 deg, 400 km/s, 2.662e-6 rad/s."""
    return polar(range_rsun, 30.0 - np.degrees((range_rsun - 1) * R_SUN_KM * 2.662e-6 / 400.0))


def grid_of(sources, receivers, sigma_s, *, noise=0.0, v_over_c=1.0, emission_s=0.0) -> ArrivalGrid:
    """Arrival times of sources, one per frequency; `noise` in units of sigma."""
    sources = np.atleast_2d(sources)
    shape = (len(sources), len(receivers))
    distance = np.linalg.norm(sources[:, None, :] - receivers, axis=2)
    sigma = np.broadcast_to(np.asarray(sigma_s, dtype=float), shape).copy()
    speed = np.reshape(np.asarray(v_over_c, dtype=float), (-1, 1)) * C_RSUN_S
    emitted = np.reshape(np.asarray(emission_s, dtype=float), (-1, 1))
    return ArrivalGrid(
        frequency_mhz=np.linspace(0.1, 1.0, shape[0]),
        observatories=tuple(f"R{i}" for i in range(shape[1])),
        arrival_s=emitted + distance / speed + noise * sigma,
        sigma_s=sigma,
        receiver_rsun=np.broadcast_to(receivers, (*shape, 3)).copy(),
        reference_utc=REFERENCE_UTC,
        edge="half_maximum",
    )


def table_of(grid: ArrivalGrid) -> pd.DataFrame:
    """The same as an arrival table with positions."""
    rows = [
        (
            name,
            grid.frequency_mhz[f],
            REFERENCE_UTC + np.timedelta64(round(grid.arrival_s[f, i] * 1e9), "ns"),
            grid.sigma_s[f, i],
            grid.edge,
            *grid.receiver_rsun[f, i],
            *(getattr(grid, name)[f, i] for name in NUISANCE),
        )
        for f in range(grid.frequency_mhz.size)
        for i, name in enumerate(grid.observatories)
    ]
    columns = ["observatory", "frequency_mhz", "arrival_utc", "sigma_s", "edge", *POSITION, *NUISANCE]
    return pd.DataFrame(rows, columns=columns)


def first(grid: ArrivalGrid, **choices) -> xr.Dataset:
    """Solution of the first frequency, by default without a directional delay and with the prior of the paper."""
    return localise(table_of(grid), **({"draws": 10, "preset": PLAIN} | choices)).isel(frequency=0)


def moments(
    grid: ArrivalGrid,
    priors: Priors = NARROW,
    tolerance: float = TOLERANCE,
    *,
    dimensions: int = 2,
    noise: Noise = GAUSSIAN,
) -> Moments:
    problems = problems_of(grid, priors, dimensions, noise)
    return moments_of(problems, divide(problems, tolerance=tolerance))


def regions(grid: ArrivalGrid, priors: Priors = NARROW, *, dimensions: int = 2) -> list[Region]:
    problems = problems_of(grid, priors, dimensions)
    return regions_of(problems, divide(problems))


def sd_of(solved: Moments) -> np.ndarray:
    return np.sqrt(np.einsum("bii->bi", solved.covariance))


@dataclass(frozen=True)
class Brute:
    mean: np.ndarray
    covariance: np.ndarray
    v_over_c: float
    v_over_c_sd: float
    log_evidence: float


def brute_force(grid: ArrivalGrid, priors: Priors, *, pitch: float = 1.0, noise: Noise = GAUSSIAN) -> Brute:
    """Posterior of the first frequency summed on a square grid of points and of speeds, each weighted by its prior.

    The emission time alone is integrated by hand: a Gaussian with precision W. The grid is laid over the squares of a
    coarse one that come within 16 nats of its best.
    """
    coarse = 8 * pitch
    axis = np.arange(-700, 700, coarse) + coarse / 2
    points = np.stack(np.meshgrid(axis, axis, indexing="ij")).reshape(2, -1)
    speeds, log_prior_v = speed_grid(priors, grid.sigma_s[0])
    height = np.logaddexp.reduce(log_joint(points, grid, priors, speeds, noise) + log_prior_v, axis=1)
    points = points[:, height > height.max() - 16]
    offset = (np.arange(8) - 3.5) * pitch
    fine = np.stack(np.meshgrid(offset, offset, indexing="ij")).reshape(2, -1)
    points = (points[:, :, None] + fine[:, None, :]).reshape(2, -1)
    joint = np.concatenate(
        [
            log_joint(some, grid, priors, speeds, noise) + log_prior_v
            for some in np.array_split(points, max(1, points.shape[1] // 2_000), axis=1)
        ]
    )
    top = joint.max()
    mass = np.exp(joint - top)
    total = mass.sum()
    of_point, of_speed = mass.sum(axis=1) / total, mass.sum(axis=0) / total
    mean = points @ of_point
    deviation = points - mean[:, None]
    v = of_speed @ speeds
    return Brute(
        mean,
        (of_point * deviation) @ deviation.T,
        v,
        np.sqrt(of_speed @ (speeds - v) ** 2),
        top + np.log(total * pitch**2 * (speeds[1] - speeds[0])),
    )


def speed_grid(priors: Priors, sigma_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # steps stay below the width of the prior, and below that of the likelihood for errors down to 7 s
    steps = 29 if priors.v_sd_c < 0.01 else 57 if sigma_s.min() > 10 else 141
    top = min(7.0, (priors.v_max_c - 1) / priors.v_sd_c)
    z = np.linspace(-7, top, 4 * steps if priors.is_truncated else steps)
    log_prior = -0.5 * z**2 - np.log(priors.v_sd_c * np.sqrt(2 * np.pi)) - priors.log_share_allowed
    if priors.is_truncated:
        log_prior[-1] -= np.log(2)  # the trapezium rule, where the density ends at its highest
    return 1 + priors.v_sd_c * z, log_prior


def log_joint(points, grid: ArrivalGrid, priors: Priors, speeds, noise: Noise = GAUSSIAN) -> np.ndarray:
    """log p(y, x | v) of the first frequency, points x speeds."""
    p, number = noise.bad_probability, len(grid.observatories)
    sets = [()] + ([(i,) for i in range(number)] if p else [])
    prior = np.array([np.log(p) * len(some) + np.log1p(-p) * (number - len(some)) if p else 0.0 for some in sets])
    prior = prior - np.logaddexp.reduce(prior)
    parts = []
    for some, log_prior in zip(sets, prior, strict=True):
        sigma = grid.sigma_s[0].copy()
        sigma[list(some)] = np.hypot(sigma[list(some)], noise.bad_sd_s)
        parts.append(log_prior + log_gaussian(points, grid, sigma, priors, speeds))
    return np.logaddexp.reduce(parts, axis=0)


def log_gaussian(points, grid: ArrivalGrid, sigma, priors: Priors, speeds) -> np.ndarray:
    arrival, receiver = grid.arrival_s[0], grid.receiver_rsun[0]
    w = sigma**-2.0
    tau, half_width = priors.tau_rsun, priors.emission_half_width_s
    d = np.sqrt((points[0][:, None] - receiver[:, 0]) ** 2 + (points[1][:, None] - receiver[:, 1]) ** 2)
    d = np.hypot(d, receiver[:, 2])
    d_centred = d - (d @ w)[:, None] / w.sum()
    y_centred = arrival - arrival @ w / w.sum()
    a, b, c = d_centred**2 @ w, d_centred @ (w * y_centred), y_centred**2 @ w
    u = 1 / (speeds * C_RSUN_S)
    misfit = a[:, None] * u**2 - 2 * b[:, None] * u + c
    constant = (
        -0.5 * (w.size - 1) * np.log(2 * np.pi)
        + 0.5 * np.log(w).sum()
        - 0.5 * np.log(w.sum())
        - np.log(2 * half_width)
        - np.log(2 * np.pi * tau**2)
    )
    return constant - 0.5 * misfit - 0.5 * (points**2).sum(axis=0)[:, None] / tau**2


def inside(outline: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Which points lie inside closed polygons separated by NaN (even-odd rule)."""
    start, stop = outline[:-1], outline[1:]
    whole = np.isfinite(start).all(axis=1) & np.isfinite(stop).all(axis=1)
    (x0, y0), (x1, y1) = start[whole].T, stop[whole].T
    x, y = points[:, 0, None], points[:, 1, None]
    crosses = (y0 > y) != (y1 > y)
    rise = np.where(y1 == y0, 1.0, y1 - y0)
    right = x < x0 + (y - y0) / rise * (x1 - x0)
    return (crosses & right).sum(axis=1) % 2 == 1


def polygon_area(outline: np.ndarray) -> float:
    """Area inside closed polygons separated by NaN; holes run the other way round and count negative."""
    start, stop = outline[:-1], outline[1:]
    whole = np.isfinite(start).all(axis=1) & np.isfinite(stop).all(axis=1)
    (x0, y0), (x1, y1) = start[whole].T.astype(float), stop[whole].T.astype(float)
    return abs(0.5 * float((x0 * y1 - x1 * y0).sum()))

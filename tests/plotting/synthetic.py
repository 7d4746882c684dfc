"""A burst with a known track: posteriors that are Gaussian blobs along a line, and spectra with the burst in them."""

import numpy as np
import pandas as pd
import xarray as xr

from bella.heliosphere import spiral_longitude_deg
from bella.units import C_RSUN_S

FREQUENCIES_MHZ = np.geomspace(0.15, 2.0, 200)
RECEIVERS = {"WIND": (216.0, 0.0), "STEREO-A": (206.0, 116.7), "STEREO-B": (215.0, -116.7)}
REFERENCE = "2012-06-07T19:21:00Z"
BURST_ID = "T3-20120607-1929"
PERIOD_D = 24.47
FITS = {"gauss_hermite": (30.0, 400.0), "half_maximum": (14.0, 1900.0), "shared_profile": (14.0, 1900.0)}
VERTICES = 73
UNITS = {"frequency": "MHz", "x_rsun": "solRad", "area68_rsun2": "solRad2", "arrival_s": "s"}


def synthetic_track(edge: str, frequency_mhz: np.ndarray) -> np.ndarray:
    """Positions (F, 2) along the spiral of an edge definition, 152 to 12 solar radii."""
    phi0, speed = FITS[edge]
    logs = np.log(frequency_mhz / 2.0) / np.log(0.15 / 2.0)
    radius = 12.0 * (152.0 / 12.0) ** logs
    angle = np.radians(spiral_longitude_deg(radius, phi0, speed, PERIOD_D))
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


def synthetic_posterior(
    edge: str = "gauss_hermite", *, frequencies: np.ndarray = FREQUENCIES_MHZ, draws: int = 50
) -> xr.Dataset:
    """Posterior dataset of one edge definition, in the layout that the localiser writes."""
    rng = np.random.default_rng(7)
    mean = synthetic_track(edge, frequencies)
    count = len(frequencies)
    radius = np.hypot(*mean.T)
    xx, yy = (8.0 + 0.05 * radius) ** 2, (10.0 + 0.06 * radius) ** 2
    xy = 0.1 * np.sqrt(xx * yy)
    covariance = np.stack([np.stack([xx, xy], -1), np.stack([xy, yy], -1)], -2)
    root = np.linalg.cholesky(covariance)
    receivers = np.array([[r * np.cos(np.radians(a)), r * np.sin(np.radians(a)), 0.0] for r, a in RECEIVERS.values()])
    emission = 5.0 + 60.0 * (1 / frequencies - 0.5)
    arrival = emission[:, None] + np.linalg.norm(receivers[None, :, :2] - mean[:, None], axis=2) / C_RSUN_S
    drawn = np.empty((count, draws, 4), np.float32)
    drawn[..., :2] = mean[:, None] + np.einsum("fij,fdj->fdi", root, rng.standard_normal((count, draws, 2)))
    drawn[..., 2] = emission[:, None] + 20 * rng.standard_normal((count, draws))
    drawn[..., 3] = 1 + 0.001 * rng.standard_normal((count, draws))
    flat = np.ones(count)
    variables = {
        "draws": (("frequency", "draw", "parameter"), drawn),
        **{
            name: ("frequency", values)
            for name, values in {
                "x_rsun": mean[:, 0],
                "y_rsun": mean[:, 1],
                "z_rsun": 0 * flat,
                "cov_xx_rsun2": xx,
                "cov_xy_rsun2": xy,
                "cov_yy_rsun2": yy,
                "mode_x_rsun": mean[:, 0],
                "mode_y_rsun": mean[:, 1],
                "area68_rsun2": 2.279 * np.pi * np.sqrt(xx * yy - xy**2),
                "area95_rsun2": 5.991 * np.pi * np.sqrt(xx * yy - xy**2),
                "modes": np.ones(count, np.int16),
                "emission_s": emission,
                "emission_sd_s": 20 * flat,
                "v_over_c": flat,
                "v_over_c_sd": 0.001 * flat,
                "contraction_x": 0.12 * flat,
                "contraction_y": 0.15 * flat,
                "contraction_v": 0.99 * flat,
                "log_evidence": -12.0 * flat,
                "draw_ess": 3800.0 * flat,
                "flags": np.array(["speed_not_constrained"] * count),
            }.items()
        },
        "region68": (("frequency", "vertex", "axis"), _ellipses(mean, root, 1.5096)),
        "region95": (("frequency", "vertex", "axis"), _ellipses(mean, root, 2.4477)),
        "arrival_s": (("frequency", "observatory"), arrival),
        "sigma_s": (("frequency", "observatory"), np.broadcast_to([30.0, 30.0, 30.0], arrival.shape).copy()),
        "receiver_rsun": (("frequency", "observatory", "xyz"), np.broadcast_to(receivers, (count, 3, 3)).copy()),
    }
    posterior = xr.Dataset(
        variables,
        coords={
            "frequency": frequencies,
            "parameter": ["x_rsun", "y_rsun", "emission_s", "v_over_c"],
            "observatory": list(RECEIVERS),
            "axis": ["x", "y"],
            "xyz": ["x", "y", "z"],
        },
        attrs={
            "Conventions": "CF-1.11",
            "title": "synthetic burst",
            "frame": "HEE",
            "reference_time": REFERENCE,
            "method": "posterior",
            "preset": "bella-2024",
            "edge": edge,
            "dimensions": 2,
            "format_version": 1,
            "v_prior_sd_over_c": 0.001,
            "tau_rsun": 80.65,
            "sigma_rule": "30 s for all",
            "seed": 7,
            "bella_version": "0.1.0",
            "burst_id": BURST_ID,
        },
    )
    for name in posterior.variables:
        posterior[name].attrs = {"units": UNITS.get(str(name), "1"), "long_name": str(name).replace("_", " ")}
    return posterior


def synthetic_track_fit(edge: str = "gauss_hermite") -> dict:
    """Track fit of an edge definition, as kept in the catalogue."""
    phi0, speed = FITS[edge]

    def quantity(mean: float, sd: float) -> dict[str, float]:
        ladder = {"q2_5": -1.96, "q16": -0.994, "q50": 0.0, "q84": 0.994, "q97_5": 1.96}
        return {"mean": mean, "sd": sd, **{name: mean + k * sd for name, k in ladder.items()}}

    def fit(period: float) -> dict:
        return {
            "phi0_deg": quantity(phi0, 0.8),
            "v_sw_km_s": quantity(speed * PERIOD_D / period, 0.03 * speed),
            "r0_rsun": 1.0,
            "points": 200,
            "rms_rsun": 1.7,
            "rotation_period_d": period,
            "flags": [],
            "model": "two-step",
        }

    return {
        "frame": "HEE",
        "rotation_period_d": PERIOD_D,
        "two_step": fit(PERIOD_D),
        "two_step_other_rotations": {"25.38": fit(25.38)},
        "joint": synthetic_joint(phi0, speed),
        "companions": synthetic_companions(phi0),
    }


def synthetic_joint(phi0: float, speed: float) -> dict:
    """Joint fit whose errors are larger than those of the line, and whose wind is skewed."""

    def quantity(mean: float, sd: float, low: float, high: float) -> dict[str, float]:
        middle = {"q16": mean - sd, "q50": mean, "q84": mean + sd}
        return {"mean": mean, "sd": sd, "q2_5": low, **middle, "q97_5": high, "contraction": 0.3}

    return {
        "model": "free distance, free time of emission",
        "phi0_deg": quantity(phi0 - 1.0, 4.4, phi0 - 10.0, phi0 + 8.0),
        "v_sw_km_s": quantity(1.1 * speed, 0.2 * speed, 0.8 * speed, 1.6 * speed)
        | {"q16": 0.9 * speed, "q50": 1.05 * speed, "q84": 1.25 * speed},
        "beam_speed_c": quantity(0.5, 0.02, 0.46, 0.54),
        "release_utc": {"mean": "2012-06-07T19:20:29.779Z", "sd": 8.8},
        "chi2": 88.0,
        "freedom": 85,
        "misfit_p": 0.4,
        "rotation_period_d": PERIOD_D,
        "flags": [],
    }


def synthetic_companions(phi0: float) -> dict:
    """SEMP apart from the joint fit, a footpoint, and a piecewise spiral that could not be fitted."""
    foot = {"mean": phi0 - 1.2, "sd": 4.4, "q2_5": phi0 - 10, "q16": phi0 - 5.6, "q84": phi0 + 3.2, "q97_5": phi0 + 8}
    angles = {"connection_angle_deg": {"mean": 33.0, "sd": 4.4}, "at_300_km_s_deg": 53.0, "at_600_km_s_deg": 12.0}
    return {
        "semp": {
            "model": "one beam",
            "phi0_deg": {"mean": phi0 - 19.0, "sd": 5.9},
            "beam_speed_c": {"mean": 0.15, "sd": 0.005},
            "release_utc": {"mean": "2012-06-07T19:20:03.643Z", "sd": 11.2},
            "v_sw_km_s": 400.0,
            "rms_s": 71.2,
            "error_scale": 2.4,
            "rotation_period_d": 27.32,
            "flags": [],
        },
        **synthetic_scattering(),
        "piecewise": {"flags": ["not_computed"], "reason": "a spiral needs 3 positions; add frequencies"},
        "footpoint": {
            "stonyhurst": foot,
            "carrington": {name: value + 182.6 * (name != "sd") for name, value in foot.items()},
            "connections": [
                {"observatory": "WIND", "flags": [], **angles},
                {"observatory": "VOYAGER", "flags": ["not_computed"], "reason": "VOYAGER is not known"},
            ],
            "flags": [],
        },
    }


def synthetic_scattering() -> dict:
    """Density excess and scattering at two frequencies, the higher of which no model was computed for."""
    excess = {"mean": 4.8, "q16": 3.9, "q84": 5.8}
    nothing = {"range_rsun": None, "range_sd_rsun": None, "delay_s": None, "excess": dict.fromkeys(excess)}
    inside = {
        "range_rsun": 40.0,
        "range_sd_rsun": 4.2,
        "delay_s": 394.0,
        "excess": {"mean": 1.2, "q16": 1.0, "q84": 1.5},
    }
    row = {"frequency_mhz": 0.167, "apparent_rsun": 86.0, "apparent_sd_rsun": 9.0}
    far = {"frequency_mhz": 25.0, "apparent_rsun": 1.5, "apparent_sd_rsun": None}
    spiral = {"phi0_deg": {"mean": 29.1, "sd": 4.4}, "v_sw_km_s": {"mean": 188.0, "sd": 31.0}}
    return {
        "density_excess": {
            "rows": [
                {"frequency_mhz": 0.167, "range_rsun": 86.0, "range_sd_rsun": 9.0, "harmonic": excess},
                {"frequency_mhz": 25.0, "range_rsun": 1.5, "range_sd_rsun": None},
            ],
            "flags": [],
        },
        "scattering": {
            "source": "Kontar et al. 2023, ApJ 956, 112, doi:10.3847/1538-4357/acf6c1",
            "not_in_errors": "half or twice the nominal turbulence",
            "rows": [
                {**row, "fundamental": inside, "harmonic": {**inside, "range_rsun": 61.2, "delay_s": 201.0}},
                {**far, "fundamental": nothing, "harmonic": nothing},
            ],
            "joint": {"fundamental": spiral},
            "flags": [],
        },
    }


def synthetic_spectra() -> xr.DataTree:
    """Three dynamic spectra in which the burst starts where the Gauss-Hermite edge says."""
    posterior = synthetic_posterior()
    start = np.datetime64(REFERENCE.removesuffix("Z"), "ns")
    cadences = {"WIND": 60.0, "STEREO-A": 38.8, "STEREO-B": 38.8}
    rng = np.random.default_rng(3)
    children = {}
    for name, cadence in cadences.items():
        seconds = np.arange(-120.0, 3600.0, cadence)
        channels = np.geomspace(0.06, 6.0, 70) if name == "WIND" else np.arange(0.125, 2.0, 0.05)
        onset = np.interp(channels, posterior["frequency"], posterior["arrival_s"].sel(observatory=name))
        late = seconds[:, None] - onset[None, :]
        decay = 60.0 + 90.0 / channels[None, :]
        burst = np.where(late > 0, np.exp(-late / decay), np.exp(-((late / 45.0) ** 2)))
        noise = 0.02 * rng.standard_normal(burst.shape)
        children[name] = xr.Dataset(
            {"intensity": (("time", "frequency"), (burst + noise).astype(np.float32))},
            coords={"time": start + (seconds * 1e9).astype("timedelta64[ns]"), "frequency": channels},
            attrs={"observatory": name, "receiver": "synthetic", "quantity": "relative_flux", "integration_s": cadence},
        )
    return xr.DataTree.from_dict({f"/{name}": child for name, child in children.items()})


def synthetic_samples() -> pd.DataFrame:
    """Light curves of two spacecraft on a shared profile, at the ends of a band; the last one is out of sight."""
    widths = np.array([-1.0, 0.0, 1.0, 9.0])
    rows = [
        {"observatory": name, "frequency_mhz": mhz, "widths": w, "height": 0.5 + 0.3 * w, "fitted": 0.5 + 0.3 * w - off}
        for name, off in (("WIND", 0.0), ("STEREO-A", 0.1))
        for mhz in (0.2, 4.0)
        for w in widths
    ]
    return pd.DataFrame(rows)


def _ellipses(mean: np.ndarray, root: np.ndarray, factor: float) -> np.ndarray:
    angle = np.linspace(0, 2 * np.pi, VERTICES)
    unit = factor * np.column_stack([np.cos(angle), np.sin(angle)])
    outlines = mean[:, None] + np.einsum("fij,vj->fvi", root, unit)
    padding = np.full((len(mean), 9, 2), np.nan)
    return np.concatenate([outlines, padding], axis=1).astype(np.float32)

"""The track of a burst: one source on one Parker spiral, fitted to all arrival times together, and what it says."""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.special import ndtr

from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError
from bella.flags import NOT_CONSTRAINED
from bella.heliosphere import spiral_path_rsun
from bella.records import Interval, JointTrack, Moment, NoiseOfEdges, Parameter, SourceAt, WindPart
from bella.tracks.directions import DirectionTerms
from bella.tracks.likelihood import Likelihood, evidence_of
from bella.tracks.model import WIND_KM_S, Track, TrackModel, WindPrior
from bella.tracks.posterior import Draws, Nodes, around_the_circle, cells, propagated, reweighted
from bella.tracks.quality import (
    WIDTHS_DIFFER,
    Quality,
    doubted,
    has_shape,
    quality_of,
    with_shape,
    without_clocks,
    without_outliers,
)
from bella.units import C_RSUN_S, FloatArray, within_half_turn_deg

QUANTILES = {"q2_5": 0.025, "q16": 0.16, "q50": 0.5, "q84": 0.84, "q97_5": 0.975}
DRAWS, FEWEST_DRAWS = 4000, 100
MIN_FREQUENCIES, MIN_TIMES = 4, 12
"""Fewer frequencies, or arrival times, leave nothing to fit."""

MIN_EFFECTIVE, GOOD_EFFECTIVE = 50, 400
"""Effective draws below which weights mean nothing, and below which they are rough: 100 for each of four chains
(Vehtari et al. 2021, doi:10.1214/20-BA1221)."""

PROFILE = 12
"""Frequencies at which the track is written out."""

UNIFORM_WIDTH_DEG = 0.68 * 360.0
NOT_NARROWER = 0.95
"""An interval over that of the prior from which it is not narrower, given how well draws know its ends."""

JOINED_DEG = 2.0
"""Parts of a region with a smaller gap are one: nobody sees two tracks so close."""

LEAST_ORDERLY = 0.01
"""Share of the draws whose distance and time of emission fall with frequency throughout, below which order is not asked
for: the times contradict it."""

FAST_WIND_KM_S, FAST_PROBABILITY, NO_SPIRAL, SPIRAL_KM_S = 1500.0, 0.05, 4.0, 800.0
"""A wind above this, with more than this probability, that explains the times so many times better than one of 800 to
1500 km/s: the longitude does not fall with distance. Where the times say nothing of the wind both explain them alike.
The ratio is at most 1 for 24 simulated spirals of laws that are not those of the fit, 3.0 for the half-maximum edges of
2012-06-07, whose wind is not measured, and 6 to 230 for bursts whose longitude grows or stays along their way."""

BEAM_SPEEDS_C = (0.03, 0.6)
"""Speeds of beams of Type III bursts in the literature (Reid & Ratcliffe 2014, doi:10.1088/1674-4527/14/7/003)."""

UNLIKELY_BAND = 1 / 3
"""Share of the band with other speeds from which the times are not those of one source: 0.4 for 2019-04-09 with one
spacecraft on another time scale; of 400 simulated bursts one has such speeds anywhere."""


@dataclass(frozen=True)
class TrackFit:
    """A fitted track: its record, and the draws behind it.

    Attributes
    ----------
    record : JointTrack
    likelihood : Likelihood
        With the noise and the arrival times that were used in the end.
    reference_utc : numpy.datetime64
        What seconds count from; also the epoch of the HEE axes.
    draws : dict of str to ndarray, shape (M,)
        Of equal weight, in natural units: ``phi0_deg``, ``v_sw_km_s``, ``beam_speed_c``, ``release_s``, ``kappa``. The
        longitude is not wrapped where the posterior lies across +-180 degrees. Empty where nothing was fitted.
    z : ndarray, shape (M, P)
        The same in the parameters of the track.
    nodes : Nodes or None
        Best parameters around the circle; None where nothing was fitted.
    """

    record: JointTrack
    likelihood: Likelihood
    reference_utc: np.datetime64
    draws: dict[str, FloatArray] = field(default_factory=dict)
    z: FloatArray = field(default_factory=lambda: np.empty((0, 0)))
    nodes: Nodes | None = None

    @property
    def track(self) -> Track:
        """The model on the band of the burst."""
        return self.likelihood.track

    def range_rsun(self, frequency_mhz: FloatArray) -> FloatArray:
        """Draws of the distance of the source from the Sun at frequencies, solar radii, shape (M, F)."""
        return self.track.range_rsun(self.z, self.track.basis(frequency_mhz))

    def longitude_deg(self, range_rsun: FloatArray) -> FloatArray:
        """Draws of the longitude of the spiral at distances, degrees HEE, shape (M, F)."""
        phi0 = np.radians(self.draws["phi0_deg"])
        return np.degrees(self.track.longitude_rad(phi0, self.z, range_rsun))


def fit_track(
    grid: ArrivalGrid,
    model: TrackModel | None = None,
    *,
    directions: DirectionTerms | None = None,
    draws: int = DRAWS,
    seed: int = 0,
) -> TrackFit:
    """Fit a track to the arrival times of a burst.

    Parameters
    ----------
    grid : ArrivalGrid
        With the noise of its edges; frequencies received by one or two receivers count too.
    model : TrackModel, optional
    directions : DirectionTerms, optional
        Wave directions to fit as well; those outside the band of the times are left out.
    draws : int
    seed : int

    Returns
    -------
    TrackFit
        Without numbers, and with a flag, where there are too few frequencies or arrival times.

    Raises
    ------
    InputError
        If `draws` is below 100.
    """
    if draws < FEWEST_DRAWS:
        raise InputError(f"{draws} draws are too few; ask for {FEWEST_DRAWS} or more")
    band_mhz = (float(grid.frequency_mhz[0]), float(grid.frequency_mhz[-1]))
    inside = None if directions is None else directions.within(*band_mhz)
    begin = Likelihood(Track(model or TrackModel(), band_mhz), evidence_of(grid), inside)
    if grid.frequency_mhz.size < MIN_FREQUENCIES or begin.seen.size < MIN_TIMES:
        return TrackFit(_empty(grid, begin.track.model, ("too_few_frequencies",)), begin, grid.reference_utc)
    likelihood, nodes, dropped = without_outliers(begin)
    quality = quality_of(likelihood, nodes, grid)
    likelihood, nodes, added = with_shape(likelihood, nodes, quality, stated=has_shape(grid))
    quality = replace(quality, added=added, dropped=dropped)
    likelihood, nodes = without_clocks(likelihood, nodes)
    return _fitted(likelihood, nodes, quality, grid, draws, np.random.default_rng(seed))


def refit(fit: TrackFit, grid: ArrivalGrid, likelihood: Likelihood, *, draws: int = DRAWS, seed: int = 0) -> TrackFit:
    """Fit another model, or with other directions, to the arrival times and the noise that a fit used in the end.

    Parameters
    ----------
    fit : TrackFit
        With draws.
    grid : ArrivalGrid
        That it was fitted to.
    """
    assert fit.nodes is not None  # noqa: S101 - a fit with draws has them
    likelihood = replace(likelihood, seen=fit.likelihood.seen)
    near = replace(fit.nodes, z=likelihood.track.nearest(fit.track, fit.nodes.z))
    nodes = around_the_circle(likelihood, near)
    quality = quality_of(likelihood, nodes, grid)
    return _fitted(likelihood, nodes, quality, grid, draws, np.random.default_rng(seed), fit.record.flags)


def _fitted(  # noqa: PLR0913, PLR0917
    likelihood: Likelihood,
    nodes: Nodes,
    quality: Quality,
    grid: ArrivalGrid,
    draws: int,
    rng: np.random.Generator,
    before: tuple[str, ...] = (),
) -> TrackFit:
    """Draws, flags and record; `before` are the flags of a fit to the same times whose errors were not yet doubted."""
    around, drawn = propagated(likelihood, nodes, draws, rng)
    effective = drawn.effective
    if effective < MIN_EFFECTIVE:  # the Gaussians of Laplace are then the better answer, with a flag
        drawn = replace(drawn, weight=np.full(draws, 1 / draws))
    values, orderly = _natural(likelihood, drawn, rng)
    is_orderly = float(drawn.weight @ orderly) > LEAST_ORDERLY
    if is_orderly:
        drawn = reweighted(drawn, orderly)
    summaries = _summaries(values, drawn.weight, likelihood.track)
    flags = tuple(
        dict.fromkeys(
            (
                *before,
                *_flags(
                    around, values, drawn.weight, summaries, quality, effective, is_orderly, likelihood.track.model.wind
                ),
            )
        )
    )
    if "not_one_source" in flags and not before:
        likelihood = doubted(likelihood)
        return _fitted(likelihood, around_the_circle(likelihood), quality, grid, draws, rng, flags)
    record = _record(likelihood, around, summaries, drawn.log_evidence, quality, grid, effective, flags)
    place = _equal(drawn.weight, rng)
    single = {name: value[place] for name, value in values.items() if value.ndim == 1}
    return TrackFit(record, likelihood, grid.reference_utc, single, drawn.z[place], nodes)


def _empty(grid: ArrivalGrid, model: TrackModel, flags: tuple[str, ...]) -> JointTrack:
    return JointTrack(
        model=model.name,
        rotation_period_d=model.rotation_period_d,
        epoch_utc=_stamp(grid.reference_utc, 0.0),
        phi0_deg=Parameter(),
        v_sw_km_s=Parameter(),
        beam_speed_c=Parameter(),
        release_utc=Moment(),
        flags=flags,
    )


def _natural(
    likelihood: Likelihood, drawn: Draws, rng: np.random.Generator
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Draws in natural units, and whether distance and time of emission rise towards lower frequencies, shape (M,)."""
    track = likelihood.track
    profile_mhz = np.geomspace(*track.band_mhz, PROFILE)
    wind_km_s = WIND_KM_S / track.slowness(drawn.z)
    range_rsun = track.range_rsun(drawn.z, track.basis(profile_mhz))
    residual_s = likelihood.residual_s(drawn.phi0_rad, drawn.z)
    mean_s, covariance_s2 = likelihood.emission(residual_s, profile_mhz)
    value, vector = np.linalg.eigh(covariance_s2)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    emission_s = mean_s + rng.standard_normal(mean_s.shape) @ root.T + track.beam_s(drawn.z, range_rsun)
    path_rsun = spiral_path_rsun(range_rsun, wind_km_s.mean(axis=1)[:, None], track.model.rotation_period_d)
    with np.errstate(divide="ignore", invalid="ignore"):  # draws without order are weighted down below
        beam_c = _finite((path_rsun[:, 0] - path_rsun[:, -1]) / (emission_s[:, 0] - emission_s[:, -1]) / C_RSUN_S)
        local_c = _finite(np.gradient(path_rsun, axis=1) / np.gradient(emission_s, axis=1) / C_RSUN_S)
        release_s = emission_s[:, -1] - path_rsun[:, -1] / (beam_c * C_RSUN_S)
    orderly = (np.diff(range_rsun, axis=1) < 0).all(axis=1) & (np.diff(emission_s, axis=1) < 0).all(axis=1)
    middle = np.degrees(np.angle(drawn.weight @ np.exp(1j * drawn.phi0_rad)))
    values = {
        "phi0_deg": middle + within_half_turn_deg(np.degrees(drawn.phi0_rad) - middle),
        **{_wind_name(part): wind_km_s[:, part] for part in range(track.winds)},
        "beam_speed_c": beam_c,
        "release_s": _finite(release_s),
        "kappa": track.kappa(drawn.z),
        "range_rsun": range_rsun,
        "longitude_deg": np.degrees(track.longitude_rad(drawn.phi0_rad, drawn.z, range_rsun)),
        "local_speed_c": local_c,
    }
    return values, orderly.astype(np.float64)


def _finite(value: FloatArray) -> FloatArray:
    return np.nan_to_num(value, posinf=0.0, neginf=0.0)


def _wind_name(part: int) -> str:
    return "v_sw_km_s" if part == 0 else f"v_sw_{part + 1}_km_s"


def _summaries(values: dict[str, FloatArray], weight: FloatArray, track: Track) -> dict[str, list[Parameter]]:
    """What the draws say of every parameter; of a profile one for each of its frequencies."""
    widths = dict.fromkeys(map(_wind_name, range(track.winds)), track.wind_width_km_s)
    widths |= {"phi0_deg": UNIFORM_WIDTH_DEG, "kappa": 2 * track.model.delay.kappa_sd}
    return {
        name: [summary(one, weight, widths.get(name)) for one in np.atleast_2d(value.T)]
        for name, value in values.items()
    }


def is_no_spiral(wind_km_s: FloatArray, weight: FloatArray, prior: WindPrior) -> bool:
    """Whether winds so fast that hardly a spiral is left explain arrival times better than those of fast spirals.

    The prior of the wind does not matter: it is taken out of both.

    Parameters
    ----------
    wind_km_s, weight : ndarray, shape (M,)
        Draws; the weights add up to one.
    """
    slowness = np.array([-np.inf, WIND_KM_S / FAST_WIND_KM_S, WIND_KM_S / SPIRAL_KM_S])
    fast, spiral = np.diff(ndtr((slowness - prior.slowness) / prior.slowness_sd))
    is_fast = wind_km_s > FAST_WIND_KM_S
    now_fast, now_spiral = weight @ is_fast, weight @ ((wind_km_s > SPIRAL_KM_S) & ~is_fast)
    return bool(now_fast > FAST_PROBABILITY and now_fast * spiral > NO_SPIRAL * now_spiral * fast)


def _flags(  # noqa: PLR0913, PLR0917
    nodes: Nodes,
    values: dict[str, FloatArray],
    weight: FloatArray,
    summaries: dict[str, list[Parameter]],
    quality: Quality,
    effective: float,
    is_orderly: bool,
    prior: WindPrior,
) -> list[str]:
    low, high = BEAM_SPEEDS_C
    wind, phi0 = summaries["v_sw_km_s"][0], summaries["phi0_deg"][0]
    whole, local = (
        float(np.mean([(one.q16 or 0.0) > high or (one.q84 or 0.0) < low for one in summaries[name]]))
        for name in ("beam_speed_c", "local_speed_c")
    )
    applies = {
        "v_sw_not_constrained": (wind.contraction or 0.0) >= NOT_NARROWER,
        "phi0_not_constrained": (phi0.contraction or 0.0) >= NOT_CONSTRAINED,
        "not_a_spiral": is_no_spiral(values["v_sw_km_s"], weight, prior),
        "several_tracks": len(region(nodes, 0.95)) > 1,
        **quality.flags,
        "beam_speed_unlikely": not is_orderly or whole > 0 or local > 0,
        "poor_weights": effective < GOOD_EFFECTIVE,
    }
    applies["not_one_source"] = (
        quality.width_share > WIDTHS_DIFFER
        or applies["not_a_spiral"]
        or not is_orderly
        or whole > 0
        or local > UNLIKELY_BAND
        or (applies["edges_differ"] and applies["clock_offset"])
    )
    return [name for name, on in applies.items() if on]


def _record(  # noqa: PLR0913, PLR0917
    likelihood: Likelihood,
    nodes: Nodes,
    summaries: dict[str, list[Parameter]],
    log_evidence: float,
    quality: Quality,
    grid: ArrivalGrid,
    effective: float,
    flags: tuple[str, ...],
) -> JointTrack:
    track = likelihood.track
    release = summaries["release_s"][0]
    stamps = {name: _stamp(grid.reference_utc, getattr(release, name)) for name in (*QUANTILES, "mean")}
    profile = zip(
        np.geomspace(*track.band_mhz, PROFILE),
        summaries["range_rsun"],
        summaries["longitude_deg"],
        summaries["local_speed_c"],
        strict=True,
    )
    limits = (1.0, *track.model.knots_rsun, None)
    winds = [summaries[_wind_name(part)][0] for part in range(track.winds)]
    return JointTrack(
        model=track.model.name,
        rotation_period_d=track.model.rotation_period_d,
        epoch_utc=_stamp(grid.reference_utc, 0.0),
        phi0_deg=summaries["phi0_deg"][0],
        phi0_68=region(nodes, 0.68),
        phi0_95=region(nodes, 0.95),
        v_sw_km_s=winds[0],
        winds=tuple(
            WindPart(from_rsun=inner, to_rsun=outer, v_sw_km_s=wind)
            for (inner, outer), wind in zip(pairwise(limits), winds, strict=True)
            if inner is not None
        )
        if len(winds) > 1
        else (),
        beam_speed_c=summaries["beam_speed_c"][0],
        release_utc=Moment(sd=release.sd, **stamps),
        profile=tuple(
            SourceAt(frequency_mhz=float(mhz), range_rsun=distance, longitude_deg=longitude, beam_speed_c=speed)
            for mhz, distance, longitude, speed in profile
        ),
        offsets_s=dict(quality.offsets),
        noise=NoiseOfEdges(
            shape=float(np.hypot(_share(grid.shape_sd_s, grid), quality.added)),
            channel=_share(grid.sigma_s, grid),
            added=quality.added,
            kappa=summaries["kappa"][0],
        ),
        chi2=quality.chi2,
        freedom=round(quality.freedom),
        misfit_p=quality.misfit_p,
        log_evidence=log_evidence,
        ess=effective,
        times=likelihood.seen.size,
        flags=flags,
    )


def _share(error_s: FloatArray, grid: ArrivalGrid) -> float:
    """Median of an error over the half width of the rise."""
    assert grid.rise_s is not None  # noqa: S101 - the grid fills it in
    return float(np.nanmedian(np.where(np.isfinite(grid.arrival_s), error_s / grid.rise_s, np.nan)))


def summary(values: FloatArray, weight: FloatArray, prior_width: float | None) -> Parameter:
    """Moments and quantiles of weighted draws.

    Parameters
    ----------
    values, weight : ndarray, shape (M,)
        The weights add up to one.
    prior_width : float or None
        Width of the 68 % interval of the prior.
    """
    order = np.argsort(values)
    below = np.cumsum(weight[order]) - 0.5 * weight[order]
    quantiles = dict(zip(QUANTILES, np.interp(list(QUANTILES.values()), below, values[order]).tolist(), strict=True))
    mean = float(weight @ values)
    sd = float(np.sqrt(weight @ (values - mean) ** 2))
    contraction = (quantiles["q84"] - quantiles["q16"]) / prior_width if prior_width else None
    return Parameter(**quantiles, mean=mean, sd=sd, contraction=contraction)


def region(nodes: Nodes, probability: float) -> tuple[Interval, ...]:
    """Smallest region of the longitude at the Sun that holds a probability, part by part.

    Returns
    -------
    tuple of Interval
        From low to high; the most probable part first.
    """
    width = cells(nodes.phi0_rad)
    density = np.exp(nodes.log_evidence - nodes.log_evidence.max())
    share = density * width / (density @ width)
    order = np.argsort(-density)
    held = np.zeros(width.size, dtype=bool)
    held[order[: int(np.searchsorted(np.cumsum(share[order]), probability)) + 1]] = True
    if not held.all():
        held |= _gaps(held, np.degrees(width))
    if held.all():
        return (Interval(low=-180.0, high=180.0, probability=1.0),)
    first = int(np.flatnonzero(~held)[0])
    turned = np.roll(held, -first)
    starts = np.flatnonzero(turned & ~np.roll(turned, 1))
    stops = np.flatnonzero(turned & ~np.roll(turned, -1))
    edge = np.degrees(nodes.phi0_rad)
    after = np.degrees(np.diff(nodes.phi0_rad, append=nodes.phi0_rad[0] + 2 * np.pi))
    parts = []
    for start, stop in zip(starts, stops, strict=True):
        some = (np.arange(start, stop + 1) + first) % width.size
        low = float(edge[some[0]] - 0.5 * after[some[0] - 1])
        high = low + float(np.degrees(width[some].sum()))
        wrapped = float(within_half_turn_deg(low))
        parts.append(Interval(low=wrapped, high=high - low + wrapped, probability=float(share[some].sum())))
    return tuple(sorted(parts, key=lambda part: -part.probability))


def _gaps(held: np.ndarray, width_deg: FloatArray) -> np.ndarray:
    """Cells between parts of a region that are closer than `JOINED_DEG`."""
    first = int(np.flatnonzero(held)[0])
    turned, width = np.roll(held, -first), np.roll(width_deg, -first)
    gap = np.cumsum(turned) - 1  # of the held cell before it
    size = np.bincount(gap[~turned], width[~turned], minlength=int(gap[-1]) + 1)
    return np.roll(~turned & (size[gap] < JOINED_DEG), first)


def _equal(weight: FloatArray, rng: np.random.Generator) -> np.ndarray:
    """Places of draws of equal weight: systematic resampling, in random order."""
    place = (np.arange(weight.size) + rng.uniform()) / weight.size
    return rng.permutation(np.minimum(np.searchsorted(np.cumsum(weight), place), weight.size - 1))


def _stamp(reference_utc: np.datetime64, seconds: float | None) -> str:
    moment = reference_utc.astype("datetime64[ms]") + np.timedelta64(round((seconds or 0.0) * 1e3), "ms")
    return f"{moment}Z"

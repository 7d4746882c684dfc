"""The track of a burst: one source on one Parker spiral, fitted to all arrival times together, and what it says."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import chdtrc, logsumexp

from bella.arrivals import SHAPE_LENGTH_LN_F, ArrivalGrid
from bella.exceptions import InputError
from bella.heliosphere import spiral_path_rsun
from bella.records import Interval, JointTrack, Moment, NoiseOfEdges, Parameter, SourceAt
from bella.tracks.likelihood import Evidence, Likelihood, evidence_of
from bella.tracks.model import WIND_KM_S, Track, TrackModel
from bella.tracks.posterior import Draws, Nodes, around_the_circle, cells, climb, reweighted, sample
from bella.units import C_RSUN_S, FloatArray, within_half_turn_deg

QUANTILES = {"q2_5": 0.025, "q16": 0.16, "q50": 0.5, "q84": 0.84, "q97_5": 0.975}
DRAWS = 4000
MIN_FREQUENCIES, MIN_TIMES = 4, 12
"""Fewer frequencies, or arrival times, leave nothing to fit."""

MIN_EFFECTIVE, GOOD_EFFECTIVE = 50, 400
"""Effective draws below which no numbers are given, and below which they are rough: 100 for each of four chains (Vehtari
et al. 2021, doi:10.1214/20-BA1221)."""

PROFILE = 12
"""Frequencies at which the track is written out."""

UNIFORM_WIDTH_DEG = 0.68 * 360.0
FAST_WIND_KM_S, FAST_PROBABILITY = 1500.0, 0.05
"""A wind above this with more than this probability: the longitude does not fall with distance. The prior has 1e-2."""

MISFIT_P = 1e-4
"""Two-sided: chi2 is larger, or smaller, once in 10 000 times."""

PLAIN_SHAPE, COMPONENTS = 0.02, 1.3
"""With a smooth error of 0.02 of the rise, chi2 per degree of freedom is above 1.3 for two of three bursts whose
spacecraft hear different components, and for 7 % of the others (240 and 32 simulated bursts)."""

BEAM_SPEEDS_C = (0.03, 0.6)
"""Speeds of beams of Type III bursts in the literature (Reid & Ratcliffe 2014, doi:10.1088/1674-4527/14/7/003)."""

ADDED_SHARES, CHANNEL_PART = (0.05, 0.1, 0.15, 0.2, 0.3, 0.45), 1 / 3
"""Smooth errors, as shares of the half width of the rise, that are tried where a table states none or the track misses its
times; each comes with an error of the channels a third as large (0.32 and 0.10 for the burst of 2012-06-07)."""

ADDED_SCALE = 0.05
"""Mean of the exponential prior of that share: it takes a nat of evidence to add 0.05."""

ADDED_P = 0.01
"""The misfit below which smooth errors are tried though the table states some."""

EDGES_DIFFER = 0.15
"""Edges of isolated bursts of eight families differ by less than this share of the rise."""

SHARED_BAND = 0.6
"""Share of the band, in ln f, in which three spacecraft have to be timed for the track to have a check."""

BLIND_RECEIVERS, SHARED_GAP = 3, 0.15
"""Fewer receivers show no error; a spacecraft is timed within this of its channels, in ln f."""

ENOUGH_LESS = 2.0
"""Nats below the best at which no larger errors are tried."""

CLOCK_SIGMAS = 3.0
OUTLIER_SIGMAS, MOST_OUTLIERS = 6.0, 0.1
"""An arrival time so many standard deviations from what all others predict is left out, up to this share of them."""


@dataclass(frozen=True)
class TrackFit:
    """A fitted track: its record, and the draws behind it.

    Attributes
    ----------
    record : JointTrack
    track : Track
    reference_utc : numpy.datetime64
    draws : dict of str to ndarray, shape (M,)
        Of equal weight, in natural units: ``phi0_deg``, ``v_sw_km_s``, ``beam_speed_c``, ``release_s``, ``kappa``. The
        longitude is not wrapped where the posterior lies across +-180 degrees.
    z : ndarray, shape (M, P)
        The same in the parameters of `track`.
    """

    record: JointTrack
    track: Track
    reference_utc: np.datetime64
    draws: dict[str, FloatArray] = field(default_factory=dict)
    z: FloatArray = field(default_factory=lambda: np.empty((0, 0)))


def fit_track(grid: ArrivalGrid, model: TrackModel | None = None, *, draws: int = DRAWS, seed: int = 0) -> TrackFit:
    """Fit a track to the arrival times of a burst.

    Parameters
    ----------
    grid : ArrivalGrid
        With the noise of its edges; frequencies heard by one or two receivers count too.
    model : TrackModel, optional
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
    if draws < 100:
        raise InputError(f"{draws} draws are too few; ask for 100 or more")
    model = model or TrackModel()
    track = Track(model, (float(grid.frequency_mhz[0]), float(grid.frequency_mhz[-1])))
    seen = evidence_of(grid)
    if grid.frequency_mhz.size < MIN_FREQUENCIES or seen.size < MIN_TIMES:
        return TrackFit(_empty(grid, model, ("too_few_frequencies",)), track, grid.reference_utc)
    rng = np.random.default_rng(seed)
    likelihood, nodes, dropped = _without_outliers(Likelihood(track, seen))
    quality = _quality(likelihood, nodes, grid)
    likelihood, nodes, added = _with_shape(likelihood, nodes, quality, stated=bool(_has_shape(grid)))
    drawn = sample(likelihood, nodes, draws, rng)
    profile_mhz = np.geomspace(*track.band_mhz, PROFILE)
    values, orderly = _natural(likelihood, drawn, profile_mhz, rng)
    ordered = float(drawn.weight @ orderly)
    if ordered > 1 / draws:
        drawn = reweighted(drawn, orderly)
    quality = replace(quality, added=added, shared_band=_shared_band(grid))
    flags = _flags(likelihood, nodes, drawn, values, quality) + (["arrivals_down_weighted"] if dropped else [])
    if drawn.effective < MIN_EFFECTIVE:
        return TrackFit(_empty(grid, model, (*flags, "poor_weights")), track, grid.reference_utc)
    record = _record(likelihood, nodes, drawn, values, quality, grid, tuple(dict.fromkeys(flags)))
    place = _equal(drawn.weight, rng)
    single = {name: value[place] for name, value in values.items() if value.ndim == 1}
    return TrackFit(record, track, grid.reference_utc, single, drawn.z[place])


@dataclass(frozen=True)
class Quality:
    """How well the best track explains the arrival times, with their errors as stated.

    Attributes
    ----------
    chi2, freedom, misfit_p : float
    plain_chi2 : float
        Per degree of freedom, with a smooth error of no more than `PLAIN_SHAPE` of the rise.
    offsets_s, offset_sds_s : ndarray, shape (n,)
        Timing offset of each observatory, were it free, and its standard deviation.
    added : float
        Smooth error that the track asks for beyond what the table states, over the half width of the rise.
    shared_band : float
        Share of the band, in ln f, in which three or more spacecraft were timed.
    """

    chi2: float
    freedom: float
    misfit_p: float
    plain_chi2: float
    offsets_s: FloatArray
    offset_sds_s: FloatArray
    added: float = 0.0
    shared_band: float = 1.0


def _has_shape(grid: ArrivalGrid) -> bool:
    """Whether a table says anything of errors that are smooth along frequency."""
    return grid.measured_s2 is not None or bool(grid.shape_sd_s.any())


def _shared_band(grid: ArrivalGrid) -> float:
    """Share of the band, in ln f, in which three or more spacecraft were timed."""
    log = np.log(grid.frequency_mhz)
    heard = [log[np.isfinite(times)] for times in grid.arrival_s.T]
    step = np.linspace(log[0], log[-1], 200)
    near = sum((np.abs(step[:, None] - one).min(axis=1) < SHARED_GAP) if one.size else np.zeros(200) for one in heard)
    return float((near >= BLIND_RECEIVERS).mean())


def _with_shape(
    likelihood: Likelihood, nodes: Nodes, quality: Quality, *, stated: bool
) -> tuple[Likelihood, Nodes, float]:
    """The same with the smooth error of highest evidence added, where the table states none or is contradicted."""
    if stated and quality.misfit_p > ADDED_P:
        return likelihood, nodes, 0.0
    best = (_evidence(nodes), likelihood, nodes, 0.0)
    rows, column = likelihood.seen.rows, likelihood.seen.observatory
    apart = np.subtract.outer(*2 * [np.log(rows.frequency_mhz)])
    smooth = np.where(column[:, None] == column, np.exp(-0.5 * (apart / SHAPE_LENGTH_LN_F) ** 2), 0.0)
    size_s2 = np.outer(rows.rise_s, rows.rise_s) * (smooth + CHANNEL_PART**2 * np.eye(column.size))
    for share in ADDED_SHARES:
        wider = replace(likelihood.seen, noise_s2=likelihood.seen.noise_s2 + share**2 * size_s2)
        tried = Likelihood(likelihood.track, wider)
        found = around_the_circle(tried)
        score = _evidence(found) - share / ADDED_SCALE
        if score > best[0]:
            best = (score, tried, found, share)
        elif score < best[0] - ENOUGH_LESS:
            break
    return best[1:]


def _evidence(nodes: Nodes) -> float:
    return float(logsumexp(nodes.log_evidence + np.log(cells(nodes.phi0_rad))))


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


def _without_outliers(likelihood: Likelihood) -> tuple[Likelihood, Nodes, int]:
    """Nodes without the arrival times that all others contradict, dropped one at a time, the worst first."""
    nodes = around_the_circle(likelihood)
    most, dropped = int(MOST_OUTLIERS * likelihood.seen.size), 0
    while dropped < most:
        away = np.abs(_left_out(likelihood, nodes))
        worst = int(away.argmax())
        if away[worst] < OUTLIER_SIGMAS:
            break
        likelihood = Likelihood(likelihood.track, likelihood.seen.without(worst))
        best = nodes.take(np.array([nodes.log_evidence.argmax()]))
        nodes = climb(likelihood, best.phi0_rad, best.z)
        dropped += 1
    return likelihood, around_the_circle(likelihood) if dropped else nodes, dropped


def _left_out(likelihood: Likelihood, nodes: Nodes) -> FloatArray:
    """Arrival times less what all others predict, in standard deviations, shape (N,)."""
    residual_s, projected = _projected(likelihood, nodes)
    return np.asarray((likelihood.weight @ residual_s) / np.sqrt(np.diag(projected)))


def _projected(likelihood: Likelihood, nodes: Nodes) -> tuple[FloatArray, FloatArray]:
    """Residuals of the best track, and the inverse covariance with all of its parameters integrated out."""
    best = int(nodes.log_evidence.argmax())
    phi0, z = nodes.phi0_rad[[best]], nodes.z[[best]]
    residual_s = likelihood.residual_s(phi0, z)
    design = likelihood.track.slopes_s(phi0, z, likelihood.seen.rows)[0]
    weighed = design @ likelihood.weight
    prior = np.diag([1.0] * z.shape[1] + [0.0])
    return residual_s[0], likelihood.weight - weighed.T @ np.linalg.solve(weighed @ design.T + prior, weighed)


def _quality(likelihood: Likelihood, nodes: Nodes, grid: ArrivalGrid) -> Quality:
    residual_s, projected = _projected(likelihood, nodes)
    chi2 = float(residual_s @ likelihood.weight @ residual_s)
    freedom = max(float(np.einsum("ij,ji->", projected, likelihood.seen.noise_s2)), 1.0)
    member = (likelihood.seen.observatory[:, None] == np.arange(len(grid.observatories))).astype(np.float64)
    precision = np.einsum("ns,nm,ms->s", member, projected, member)
    with np.errstate(divide="ignore", invalid="ignore"):
        offsets_s = (member.T @ likelihood.weight @ residual_s) / precision
        sds_s = 1 / np.sqrt(precision)
    return Quality(chi2, freedom, float(chdtrc(freedom, chi2)), _plain_chi2(likelihood, nodes, grid), offsets_s, sds_s)


def _plain_chi2(likelihood: Likelihood, nodes: Nodes, grid: ArrivalGrid) -> float:
    """Chi-squared per degree of freedom, was the shape of light curves the same at all spacecraft."""
    if grid.measured_s2 is not None:
        return 0.0
    assert grid.rise_s is not None  # noqa: S101 - the grid fills it in
    plain = Likelihood(
        likelihood.track, evidence_of(replace(grid, shape_sd_s=np.minimum(grid.shape_sd_s, PLAIN_SHAPE * grid.rise_s)))
    )
    if plain.seen.size != likelihood.seen.size:
        keep = np.isin(plain.seen.arrival_s, likelihood.seen.arrival_s)
        plain = Likelihood(plain.track, replace(likelihood.seen, noise_s2=plain.seen.noise_s2[np.ix_(keep, keep)]))
    best = nodes.take(np.array([nodes.log_evidence.argmax()]))
    around = best.phi0_rad + np.radians(np.arange(-20.0, 21.0, 4.0))
    found = climb(plain, around, np.repeat(best.z, around.size, axis=0))
    residual_s, projected = _projected(plain, found)
    freedom = max(float(np.einsum("ij,ji->", projected, plain.seen.noise_s2)), 1.0)
    return float(residual_s @ plain.weight @ residual_s) / freedom


def _natural(
    likelihood: Likelihood, drawn: Draws, profile_mhz: FloatArray, rng: np.random.Generator
) -> tuple[dict[str, FloatArray], FloatArray]:
    """Draws in natural units, and whether distance and time of emission rise towards lower frequencies, shape (M,)."""
    track = likelihood.track
    wind_km_s = WIND_KM_S / track.slowness(drawn.z)
    range_rsun = track.range_rsun(drawn.z, track.basis(profile_mhz))
    residual_s = likelihood.residual_s(drawn.phi0_rad, drawn.z)
    mean_s, covariance_s2 = likelihood.emission(residual_s, profile_mhz)
    value, vector = np.linalg.eigh(covariance_s2)
    root = vector * np.sqrt(np.maximum(value, 0.0))
    emission_s = mean_s + rng.standard_normal(mean_s.shape) @ root.T + track.beam_s(drawn.z, range_rsun)
    path_rsun = spiral_path_rsun(range_rsun, wind_km_s.mean(axis=1)[:, None], track.model.rotation_period_d)
    travelled_s = emission_s[:, 0] - emission_s[:, -1]
    beam_c = (path_rsun[:, 0] - path_rsun[:, -1]) / travelled_s / C_RSUN_S
    orderly = (np.diff(range_rsun, axis=1) < 0).all(axis=1) & (np.diff(emission_s, axis=1) < 0).all(axis=1)
    phi0_deg = np.degrees(drawn.phi0_rad)
    middle = np.degrees(np.angle(drawn.weight @ np.exp(1j * drawn.phi0_rad)))
    values = {
        "phi0_deg": middle + within_half_turn_deg(phi0_deg - middle),
        "v_sw_km_s": wind_km_s[:, 0],
        "beam_speed_c": beam_c,
        "release_s": emission_s[:, -1] - path_rsun[:, -1] / (beam_c * C_RSUN_S),
        "kappa": track.kappa(drawn.z),
        **{f"v_sw_{part + 1}_km_s": wind_km_s[:, part] for part in range(1, track.winds)},
        "range_rsun": range_rsun,
        "longitude_deg": np.degrees(track.longitude_rad(drawn.phi0_rad, drawn.z, range_rsun)),
        "speed_c": np.gradient(path_rsun, axis=1) / np.gradient(emission_s, axis=1) / C_RSUN_S,
        "frequency_mhz": np.broadcast_to(profile_mhz, range_rsun.shape),
    }
    return values, orderly.astype(np.float64)


def _flags(
    likelihood: Likelihood, nodes: Nodes, drawn: Draws, values: dict[str, FloatArray], quality: Quality
) -> list[str]:
    weight = drawn.weight
    wind = summary(values["v_sw_km_s"], weight, likelihood.track.wind_width_km_s)
    phi0 = summary(values["phi0_deg"], weight, UNIFORM_WIDTH_DEG)
    low, high = BEAM_SPEEDS_C
    local = [summary(speed, weight, None) for speed in (values["beam_speed_c"], *values["speed_c"].T)]
    away = np.abs(quality.offsets_s) > CLOCK_SIGMAS * quality.offset_sds_s
    applies = {
        "v_sw_not_constrained": (wind.contraction or 0.0) >= 1.0,
        "phi0_not_constrained": (phi0.contraction or 0.0) >= 0.9,
        "not_a_spiral": float(weight @ (values["v_sw_km_s"] > FAST_WIND_KM_S)) > FAST_PROBABILITY,
        "several_tracks": len(region(nodes, 0.95)) > 1,
        "poor_fit": quality.misfit_p < MISFIT_P,
        "errors_too_large": quality.misfit_p > 1 - MISFIT_P,
        "edges_differ": quality.added >= EDGES_DIFFER,
        "two_spacecraft": quality.shared_band < SHARED_BAND,
        "components_differ": quality.plain_chi2 > COMPONENTS,
        "beam_speed_unlikely": any((one.q16 or 0.0) > high or (one.q84 or 0.0) < low for one in local),
        "clock_offset": bool(away.any()),
        "poor_weights": drawn.effective < GOOD_EFFECTIVE,
    }
    return [name for name, on in applies.items() if on]


def _record(  # noqa: PLR0913, PLR0917
    likelihood: Likelihood,
    nodes: Nodes,
    drawn: Draws,
    values: dict[str, FloatArray],
    quality: Quality,
    grid: ArrivalGrid,
    flags: tuple[str, ...],
) -> JointTrack:
    weight, model = drawn.weight, likelihood.track.model
    release = summary(values["release_s"], weight, None)
    stamps = {name: _stamp(grid.reference_utc, getattr(release, name)) for name in (*QUANTILES, "mean")}
    offsets = zip(grid.observatories, quality.offsets_s, quality.offset_sds_s, strict=True)
    profile = tuple(
        SourceAt(
            frequency_mhz=float(values["frequency_mhz"][0, place]),
            range_rsun=summary(values["range_rsun"][:, place], weight, None),
            longitude_deg=summary(values["longitude_deg"][:, place], weight, None),
            beam_speed_c=summary(values["speed_c"][:, place], weight, None),
        )
        for place in range(PROFILE)
    )
    return JointTrack(
        model=model.name,
        rotation_period_d=model.rotation_period_d,
        epoch_utc=_stamp(grid.reference_utc, 0.0),
        phi0_deg=summary(values["phi0_deg"], weight, UNIFORM_WIDTH_DEG),
        phi0_68=region(nodes, 0.68),
        phi0_95=region(nodes, 0.95),
        v_sw_km_s=summary(values["v_sw_km_s"], weight, likelihood.track.wind_width_km_s),
        beam_speed_c=summary(values["beam_speed_c"], weight, None),
        release_utc=Moment(sd=release.sd, **stamps),
        profile=profile,
        offsets_s={name: Parameter(mean=float(mean), sd=float(sd)) for name, mean, sd in offsets if np.isfinite(sd)},
        noise=NoiseOfEdges(
            shape=float(np.hypot(_share(grid.shape_sd_s, grid), quality.added)),
            channel=_share(grid.sigma_s, grid),
            added=quality.added,
            kappa=summary(values["kappa"], weight, 2 * model.delay.kappa_sd or None),
        ),
        chi2=quality.chi2,
        freedom=round(quality.freedom),
        misfit_p=quality.misfit_p,
        log_evidence=drawn.log_evidence,
        ess=drawn.effective,
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

    Returns
    -------
    Parameter
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

    Parameters
    ----------
    nodes : Nodes
    probability : float

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


def _equal(weight: FloatArray, rng: np.random.Generator) -> np.ndarray:
    """Places of draws of equal weight: systematic resampling, in random order."""
    place = (np.arange(weight.size) + rng.uniform()) / weight.size
    return rng.permutation(np.minimum(np.searchsorted(np.cumsum(weight), place), weight.size - 1))


def _stamp(reference_utc: np.datetime64, seconds: float | None) -> str:
    moment = reference_utc.astype("datetime64[ms]") + np.timedelta64(round((seconds or 0.0) * 1e3), "ms")
    return f"{moment}Z"

"""A preliminary track from two spacecraft: where on the circle the spiral of a burst may start, and how sure that is.

Two spacecraft do not place a source. Their arrival times measure, at each frequency, about r cos(longitude - middle
between the two), so that every source has a mirror image; the bend of the spiral, a distance that any density model
would give within a factor of two, and a beam that slows smoothly tell the two apart, or do not. The answer is therefore
the posterior of the longitude at 1 solar radius on the whole circle, as regions of one or several parts, with the
distance and nothing else: no position, no wind, no mean. It is published where :func:`fit_preliminary` finds that it
says something, and refused in plain words where not.
"""

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator
from scipy.special import logsumexp
from scipy.stats import chi2 as chi2_distribution
from scipy.stats import norm

from bella.arrivals import ArrivalGrid
from bella.exceptions import InputError, NotPlacedError
from bella.heliosphere import SIDEREAL_ROTATION_D
from bella.heliosphere.parker import SPIRAL_ORIGIN_RSUN
from bella.heliosphere.scattering import LITERATURE_DELAY
from bella.records import Interval, JointTrack, Moment, NoiseOfEdges, Parameter, Side, SourceAt
from bella.tracks.preliminary_model import (
    LEVEL_MHZ,
    NODES,
    SHAPE_OF_RISE,
    ArrivalModel,
    Modes,
    belonging,
    chosen,
    range_prior,
    rows_of,
    search,
)
from bella.units import FloatArray, within_half_turn_deg

MODEL_NAME = "preliminary, two spacecraft"

CELLS, LEVELS = 360, (0.68, 0.95)
WIDEN_FROM, MOST_WIDENING = 1.2, 1.5
"""Reduced chi2 from which the errors are widened by it, and up to which the answer is published."""
WIDEST_95_DEG = 180.0
LEAST_SEPARATION_DEG = 10.0
"""Below this, regions hold what they say but leave out little of the circle (simulated bursts)."""
LEAST_CHANNELS, LEAST_SPAN = 8, 2.5
"""Channels of each spacecraft, and the ratio of frequencies that both must hear."""
PROFILE_MHZ = (0.2, 0.5, 1.0, 2.0)


def _density(modes: Modes) -> FloatArray:
    """Probability of each of the `CELLS` equal parts of the circle, from -180 deg on."""
    node = np.rint((np.degrees(modes.phi0_rad) + 180) * NODES / 360).astype(int)
    log_p = np.array([logsumexp(modes.log_weight[node == place]) for place in range(NODES)])
    around = np.arange(-2, NODES + 3)
    smooth = PchipInterpolator(around * 360.0 / NODES, log_p[around % NODES])
    fine = smooth((np.arange(CELLS) + 0.5) * 360.0 / CELLS)
    probability = np.exp(fine - fine.max())
    return np.asarray(probability / probability.sum())


def _region(probability: FloatArray, level: float) -> tuple[Interval, ...]:
    """Smallest part of the circle that holds a probability: its pieces, the most probable first."""
    order = np.argsort(-probability, kind="stable")
    inside = np.zeros(CELLS, dtype=bool)
    inside[order[: np.searchsorted(np.cumsum(probability[order]), level) + 1]] = True
    if inside.all():
        return (Interval(low=-180.0, high=180.0, probability=1.0),)
    width = 360.0 / CELLS
    begins = np.flatnonzero(inside & ~np.roll(inside, 1))
    pieces = []
    for begin in begins:
        turned = np.roll(inside, -begin)
        length = int(np.argmin(turned))
        share = float(np.roll(probability, -begin)[:length].sum())
        low = float(begin * width - 180)
        pieces.append(Interval(low=low, high=low + length * width, probability=round(share, 4)))
    return tuple(sorted(pieces, key=lambda piece: -piece.probability))


def region_size_deg(region: tuple[Interval, ...]) -> float:
    """Length of all parts of a region, degrees."""
    return sum(part.high - part.low for part in region)


def _inside(region: tuple[Interval, ...]) -> npt.NDArray[np.bool_]:
    """Which cells of the circle a region covers."""
    centre = (np.arange(CELLS) + 0.5) * 360.0 / CELLS - 180.0
    covered = [((centre - part.low) % 360.0) < part.high - part.low for part in region]
    return np.asarray(np.any(covered, axis=0))


def level_of(track: JointTrack, phi0_deg: float) -> float:
    """Probability level at which a longitude enters the credible region of a preliminary track.

    Of many bursts whose final longitude is known, the levels are uniform between 0 and 1 where preliminary tracks are
    honest.

    Parameters
    ----------
    track : JointTrack
        Of tier "preliminary".
    phi0_deg : float
        Longitude of the final track at 1 solar radius, degrees HEE of the same epoch.

    Returns
    -------
    float
        Small near the most probable longitude; 0.95 on the rim of the 95 % region.

    Raises
    ------
    InputError
        If the track has no probabilities on the circle.
    """
    probability = np.array(track.phi0_probability)
    if probability.size == 0:
        raise InputError("this track has no probabilities on the circle; only preliminary tracks have")
    here = probability[int((phi0_deg + 180.0) % 360.0 * probability.size / 360.0) % probability.size]
    return float(probability[probability > here].sum() + 0.5 * probability[probability == here].sum())


def preliminary_track(grid: ArrivalGrid) -> JointTrack:
    """Posterior of the longitude of a spiral on the whole circle, from two or more spacecraft, whatever it says.

    Parameters
    ----------
    grid : ArrivalGrid
        Channels need not be common to the spacecraft (``arrival_grid(table, received_by=1)``). Where the table has no
        ``shape_sd_s`` and no ``offset_sd_s``, `SHAPE_OF_RISE` and `OFFSET_SD_S` are taken.

    Returns
    -------
    JointTrack
        Of tier "preliminary": regions of `phi0_deg`, distances in `profile`, the side; all else is empty. Where the
        best solution misses the arrival times, regions are those of errors widened by it (`error_scale`).
    """
    rows = rows_of(grid)
    prior = range_prior(float(rows.frequency_mhz.min()), float(rows.frequency_mhz.max()))
    model = ArrivalModel(rows, prior)
    modes = search(model)
    belongs = belonging(model, modes)
    if not belongs.all():
        model = ArrivalModel(chosen(rows, belongs), prior)
        modes = search(model)
    best = int(modes.log_weight.argmax())
    freedom = model.rows.arrival_s.size - 2 - (9 - float(np.trace(modes.covariance[best])))
    misfit = float(modes.chi2[best])
    reduced = misfit / freedom
    if reduced > WIDEN_FROM:
        model = ArrivalModel(chosen(model.rows, np.ones(model.rows.arrival_s.size, dtype=bool), reduced), prior)
        modes = search(model)
    probability = _density(modes)
    return JointTrack(
        tier="preliminary",
        model=MODEL_NAME,
        rotation_period_d=SIDEREAL_ROTATION_D,
        epoch_utc=f"{grid.reference_utc.astype('datetime64[ms]')}Z",
        phi0_deg=Parameter(),
        phi0_68=_region(probability, LEVELS[0]),
        phi0_95=_region(probability, LEVELS[1]),
        phi0_probability=tuple(float(p) for p in np.round(probability, 7)),
        side=_side(model, modes, grid),
        v_sw_km_s=Parameter(),
        beam_speed_c=Parameter(),
        release_utc=Moment(),
        profile=_profile(model, modes),
        noise=_noise(grid, modes),
        chi2=misfit,
        freedom=round(freedom),
        misfit_p=float(chi2_distribution.sf(misfit, freedom)),
        error_scale=float(np.sqrt(reduced)) if reduced > WIDEN_FROM else 1.0,
        times=int(np.isfinite(grid.arrival_s).sum()),
        flags=() if belongs.all() else ("arrivals_down_weighted",),
    )


def _weights(modes: Modes) -> FloatArray:
    return np.asarray(np.exp(modes.log_weight - logsumexp(modes.log_weight)))


def _quantiles(mean: FloatArray, sd: FloatArray, weight: FloatArray) -> FloatArray:
    """The 2.5, 16, 50, 84 and 97.5 % quantiles of a mixture of Gaussians."""
    at = np.linspace((mean - 5 * sd).min(), (mean + 5 * sd).max(), 800)
    below = norm.cdf((at[:, None] - mean) / sd) @ weight
    return np.interp([0.025, 0.16, 0.5, 0.84, 0.975], below, at)


def _parameter(quantiles: FloatArray, contraction: float) -> Parameter:
    q2_5, q16, q50, q84, q97_5 = (float(value) for value in quantiles)
    return Parameter(q2_5=q2_5, q16=q16, q50=q50, q84=q84, q97_5=q97_5, contraction=contraction)


def _profile(model: ArrivalModel, modes: Modes) -> tuple[SourceAt, ...]:
    """Distance at a few frequencies within those that were received; the longitude is left empty."""
    received = model.rows.frequency_mhz
    profile = []
    for frequency in (one for one in PROFILE_MHZ if received.min() <= one <= received.max()):
        basis = model.prior.basis(np.array([frequency]))[0]
        by_z = basis @ model.prior.root
        mean = basis @ model.prior.mean + modes.z[:, :5] @ by_z
        sd = np.sqrt(np.einsum("i,mij,j->m", by_z, modes.covariance[:, :5, :5], by_z))
        quantiles = _quantiles(mean, sd, _weights(modes))
        contraction = float((quantiles[3] - quantiles[1]) / (2 * np.linalg.norm(by_z)))
        distance = _parameter(np.exp(quantiles), contraction)
        profile.append(SourceAt(frequency_mhz=frequency, range_rsun=distance, longitude_deg=Parameter()))
    return tuple(profile)


def _noise(grid: ArrivalGrid, modes: Modes) -> NoiseOfEdges:
    """What was taken for the noise of the edges, in half widths of the rise."""
    assumed = grid.measured_s2 is None and not grid.shape_sd_s.any()
    received = np.isfinite(grid.arrival_s)
    shape = SHAPE_OF_RISE if assumed else float(np.median((grid.shape_sd_s / np.asarray(grid.rise_s))[received]))
    scale = LITERATURE_DELAY.kappa_sd
    mean = LITERATURE_DELAY.kappa + scale * modes.z[:, 6]
    quantiles = _quantiles(mean, scale * np.sqrt(modes.covariance[:, 6, 6]), _weights(modes))
    return NoiseOfEdges(
        shape=shape, channel=0.0, kappa=_parameter(quantiles, float((quantiles[3] - quantiles[1]) / (2 * scale)))
    )


def _side(model: ArrivalModel, modes: Modes, grid: ArrivalGrid) -> Side | None:
    """The half circle that more probably has the source at `LEVEL_MHZ`; None for more than two spacecraft."""
    if len(grid.observatories) != 2:
        return None
    middle = _middle_rad(grid)
    frequency = np.clip(LEVEL_MHZ, model.rows.frequency_mhz.min(), model.rows.frequency_mhz.max())
    basis = model.prior.basis(np.array([frequency]))[0]
    r = np.exp(basis @ model.prior.mean + modes.z[:, :5] @ (basis @ model.prior.root))
    longitude = modes.phi0_rad - model.winding_rad_rsun(modes.z)[:, 0] * (r - SPIRAL_ORIGIN_RSUN)
    towards = float(_weights(modes)[np.cos(longitude - middle) > 0].sum())
    if towards < 0.5:
        return Side(middle_deg=within_half_turn_deg(float(np.degrees(middle)) + 180.0), probability=1 - towards)
    return Side(middle_deg=within_half_turn_deg(float(np.degrees(middle))), probability=towards)


def _directions(grid: ArrivalGrid) -> FloatArray:
    """Unit vectors from the Sun to the spacecraft, in the ecliptic plane, shape (n, 2)."""
    place = np.nanmean(grid.receiver_rsun[..., :2], axis=0)
    return np.asarray(place / np.linalg.norm(place, axis=1, keepdims=True))


def _middle_rad(grid: ArrivalGrid) -> float:
    """Longitude of the middle between two spacecraft: the mirror line of their arrival times."""
    one, other = _directions(grid)
    apart = one - other
    across = np.array([-apart[1], apart[0]])
    across *= 1.0 if across @ (one + other) >= 0 else -1.0
    return float(np.arctan2(across[1], across[0]))


def separation_deg(grid: ArrivalGrid) -> float:
    """Largest angle at the Sun between two of the spacecraft, degrees."""
    unit = _directions(grid)
    return float(np.degrees(np.arccos(np.clip(unit @ unit.T, -1, 1))).max())


def _too_little(grid: ArrivalGrid) -> str | None:
    """Why arrival times are too few to be fitted at all; None if they are not."""
    received = np.isfinite(grid.arrival_s)
    if len(grid.observatories) < 2:
        return f"only {grid.observatories[0]} has arrival times; a preliminary track needs two spacecraft"
    low = max(grid.frequency_mhz[column].min() for column in received.T)
    high = min(grid.frequency_mhz[column].max() for column in received.T)
    shared = (grid.frequency_mhz >= low) & (grid.frequency_mhz <= high)
    fewest = int(received[shared].sum(axis=0).min()) if shared.any() else 0
    if fewest < LEAST_CHANNELS or high < LEAST_SPAN * low:
        return (
            f"the spacecraft share too few frequencies: {fewest} channels between {low:.3g} and {high:.3g} MHz; "
            f"needed are {LEAST_CHANNELS} of each over a factor of {LEAST_SPAN:g}"
        )
    separation = separation_deg(grid)
    if separation < LEAST_SEPARATION_DEG:
        return (
            f"the spacecraft are {separation:.1f} deg apart as seen from the Sun; below {LEAST_SEPARATION_DEG:g} deg "
            "their arrival times leave most longitudes open"
        )
    return None


def why_not_published(track: JointTrack) -> str | None:
    """Why a preliminary track is not published, in plain words; None where it is."""
    size = region_size_deg(track.phi0_95)
    if size >= WIDEST_95_DEG:
        return f"the 95 % region of the longitude covers {size:.0f} deg; only less than half of the circle is published"
    if track.error_scale**2 > MOST_WIDENING:
        return (
            f"no source explains the arrival times within their errors: chi2 {track.chi2:.0f} for {track.freedom} "
            "degrees of freedom; the edges of the two spacecraft do not belong together"
        )
    return None


def fit_preliminary(grid: ArrivalGrid, other_edges: ArrivalGrid | None = None) -> JointTrack:
    """Preliminary track of a burst from two spacecraft, where it says enough to be published.

    Parameters
    ----------
    grid : ArrivalGrid
        As :func:`preliminary_track` takes it.
    other_edges : ArrivalGrid, optional
        Arrival times of the same burst by another definition of the edge; their 68 % region must meet the first.

    Returns
    -------
    JointTrack
        Of tier "preliminary"; with the flag `one_edge` where `other_edges` is not given.

    Raises
    ------
    NotPlacedError
        Says in plain words why nothing is published.
    """
    reason = _too_little(grid)
    if reason:
        raise NotPlacedError(reason)
    track = preliminary_track(grid)
    reason = why_not_published(track)
    if reason:
        raise NotPlacedError(reason)
    if other_edges is None or _too_little(other_edges):
        return track.model_copy(update={"flags": (*track.flags, "one_edge")})
    other = preliminary_track(other_edges)
    if not (_inside(track.phi0_68) & _inside(other.phi0_68)).any():
        raise NotPlacedError(
            f"two definitions of the edge, {grid.edge} and {other_edges.edge}, put the burst at longitudes that "
            "exclude one another"
        )
    return track

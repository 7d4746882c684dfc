"""The one answer about a burst: what its solution says in one sentence, and how far that is to be trusted.

`answer_of` is a pure function of a track and of the positions beside it. What it returns is stored with the solution,
so that every list, page, file and command says the same.
"""

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Literal, Protocol

from pydantic import ValidationError

from bella.flags import APPARENT_SOURCE, FLAGS, HARMLESS_FLAGS, SERIOUS_FLAGS, UNUSABLE_POSITION_FLAGS
from bella.records import Interval, JointTrack, Moment, Parameter, Record, Tier, Track
from bella.units import within_half_turn_deg

Grade = Literal["A", "B", "C", "D"]

GRADES: dict[Grade, str] = {
    "A": "The longitude is known to 5 degrees or better (half of the 68 % interval), the track explains the arrival "
    "times within their errors, and nothing warns.",
    "B": "The longitude is known to 10 degrees or better, and no serious flag is raised.",
    "C": "There is one answer, but it is less sure than that, or a serious flag says that its errors may not hold.",
    "D": "There is no single answer: the track is preliminary, several tracks or all longitudes explain the times, "
    "they are not those of one source, or none was fitted.",
}
"""What each grade means."""

BEST_HALF_WIDTH_DEG = 5.0
"""Grade A: half of the longitudes that a large active region covers (about 10 degrees)."""

ONE_DIRECTION_DEG = 60.0
"""Positions without a track that are farther apart, seen from the Sun, are in no one direction."""

GOOD_HALF_WIDTH_DEG = 10.0
"""Grade B: what a change of the wind from 400 to 480 km/s does to where a spacecraft at 1 au is connected."""

MISFIT_TAIL = 1e-3
"""Grade A: a probability of the misfit below this, or as near to one, says that model or errors are not right."""

MOST = 0.5
"""A flag of positions counts where more than this share of the frequencies has it: some at the end of a band do not."""

WIND_STEP_KM_S = 10.0
"""Speeds of the wind are written to this: no fit is better than a few of it."""

NO_SPIRAL, NOT_MEASURED = "no spiral", "not measured"
NO_LONGITUDE = {"several_tracks", "phi0_not_constrained", "not_one_source"}
"""Flags after which no single longitude is given."""

_WHY_NO_TRACK = ("too_few_frequencies", "poor_weights", "poor_fit")


class Position(Protocol):
    """What is needed of a row of a localisation table: HEE, solar radii."""

    @property
    def x_rsun(self) -> float:
        """Towards the Earth."""

    @property
    def y_rsun(self) -> float:
        """Towards the west of the Earth."""

    @property
    def z_rsun(self) -> float:
        """Towards ecliptic north."""

    @property
    def area68_rsun2(self) -> float:
        """Area of the 68 % region."""

    @property
    def flags(self) -> str:
        """Names of flags with semicolons between them."""


class Answer(Record):
    """The answer of one solution; a number that is not known, or not one number, is None.

    Longitudes are those of the spiral at 1 solar radius, degrees HEE, west of Earth positive; `low` and `high` are the
    ends of the 68 % interval, of the distances those of the nearest and the farthest source, and of the latitudes (HEE)
    those of the southernmost and the northernmost. Sources that were taken to be in the ecliptic have no latitude. The
    area is the median of all frequencies.
    """

    tier: Tier = "final"
    grade: Grade = "D"
    sentence: str = ""
    has_track: bool = False
    phi0_deg: float | None = None
    phi0_low_deg: float | None = None
    phi0_high_deg: float | None = None
    range_low_rsun: float | None = None
    range_high_rsun: float | None = None
    latitude_low_deg: float | None = None
    latitude_high_deg: float | None = None
    area68_rsun2: float | None = None
    v_sw_km_s: float | None = None
    v_sw_low_km_s: float | None = None
    v_sw_high_km_s: float | None = None


def answer_of(track: Track | None, positions: Sequence[Position]) -> Answer:
    """Grade and sentence of a solution.

    Parameters
    ----------
    track : Track or None
        None where no joint fit was made.
    positions : sequence of Position
        Localisation table of the solution, any order; where it is empty and the track has no profile, the sentence
        says nothing of distances.

    Returns
    -------
    Answer
    """
    joint = track.joint if track else None
    flags = set(joint.flags if joint else ()) | _flags_of_most(positions)
    distances = _distances(joint, positions)
    parts = joint.phi0_68 if joint else ()
    longitude = _one_longitude(joint, flags)
    wind = None if joint is None or longitude is None or joint.tier == "preliminary" else _wind(joint)
    grade = _grade(joint, longitude, flags)
    where = _where(joint, longitude, parts, flags)
    is_asked = bool(positions) or (joint is not None and bool(joint.profile))
    if "not_one_source" in flags:
        distances, is_asked, positions = None, False, ()
    has_track = joint is not None and (joint.phi0_deg.q50 is not None or bool(parts))
    is_preliminary = joint is not None and joint.tier == "preliminary"
    placed = "" if has_track or is_preliminary else _sides(positions)
    said = [where, placed, _distance_words(distances) if is_asked else "", *_wind_words(joint, longitude, wind)]
    low, high = distances or (None, None)
    return Answer(
        tier=joint.tier if joint else "final",
        grade=grade,
        sentence=", ".join([*filter(None, said), f"grade {grade}"]),
        has_track=has_track,
        range_low_rsun=low,
        range_high_rsun=high,
        **placed_numbers(positions),
        **_named("phi0", "deg", longitude),
        **_named("v_sw", "km_s", wind),
    )


def read_track(stored: Mapping[str, Any]) -> Track | None:
    """Typed track of a stored fit, of an older version of this package too.

    Parameters
    ----------
    stored : mapping
        JSON of a track; of an older one the fields that a `Track` has are taken, and those it lacks are empty.

    Returns
    -------
    Track or None
        None where it has no joint fit.
    """
    try:
        return Track.model_validate(stored)
    except ValidationError:
        joint = stored.get("joint")
        return _older_track(stored, joint) if joint else None


def interval_68(value: Mapping[str, Any] | None) -> tuple[float, float | None, float | None] | None:
    """Median and ends of the 68 % interval of a parameter as it stands in JSON.

    Parameters
    ----------
    value : mapping or None
        With `q16`, `q50`, `q84`; where these are missing, mean and standard deviation stand in for them.

    Returns
    -------
    tuple of float or None
        Median, low end, high end, the ends None where they are not known; None where there is no number at all.
    """
    if not value:
        return None
    middle = value.get("q50") if value.get("q50") is not None else value.get("mean")
    if middle is None:
        return None
    low, high, sd = value.get("q16"), value.get("q84"), value.get("sd")
    if (low is None or high is None) and sd is not None:
        low, high = middle - sd, middle + sd
    return middle, low, high


def written_68(parameter: Mapping[str, Any] | None, digits: int = 1) -> str:
    """Median with its 68 % interval, such as "26.1 (22.0 to 30.9)"; empty where there is no number.

    Parameters
    ----------
    parameter : mapping or None
        As `interval_68` takes it.
    digits : int
        Decimals.

    Returns
    -------
    str
    """
    known = interval_68(parameter)
    if known is None:
        return ""
    middle, low, high = known
    said = f"{middle:.{digits}f}"
    return said if low is None or high is None else f"{said} ({low:.{digits}f} to {high:.{digits}f})"


def written_wind(fit: Mapping[str, Any]) -> str:
    """Speed of the wind of a fit with its unit, or why there is none; empty where nothing is said of it.

    Parameters
    ----------
    fit : mapping
        As `wind_gap` takes it.

    Returns
    -------
    str
    """
    speed = fit.get("v_sw_km_s")
    said = written_68(speed if isinstance(speed, Mapping) else None, 0)
    return wind_gap(fit) or (f"{said} km/s" if said else "")


def wind_gap(fit: Mapping[str, Any]) -> str:
    """Why a fit gives no speed of the wind: "no spiral", "not measured", or nothing where it gives one.

    Parameters
    ----------
    fit : mapping
        One fit of a track, or one of its segments, as it stands in JSON.

    Returns
    -------
    str
    """
    flags, speed = set(fit.get("flags", ())), fit.get("v_sw_km_s")
    known = interval_68(speed) if isinstance(speed, Mapping) else None
    if "not_a_spiral" in flags or (known is not None and min(one for one in known if one is not None) <= 0):
        return NO_SPIRAL
    return NOT_MEASURED if known is not None and "v_sw_not_constrained" in flags else ""


def _older_track(stored: Mapping[str, Any], joint: Mapping[str, Any]) -> Track:
    names = ("phi0_deg", "v_sw_km_s", "beam_speed_c")
    period = joint.get("rotation_period_d") or stored.get("rotation_period_d") or 0.0
    kept = {
        name: joint[name]
        for name in ("tier", "misfit_p", "log_evidence", "ess", "flags", "chi2", "freedom")
        if joint.get(name) is not None
    }
    return Track(
        remark=stored.get("remark") or APPARENT_SOURCE,
        rotation_period_d=stored.get("rotation_period_d") or period,
        joint=JointTrack(
            model=joint.get("model", "not stated"),
            rotation_period_d=period,
            epoch_utc=joint.get("epoch_utc") or "",
            release_utc=Moment(**_fields(Moment, joint.get("release_utc"))),
            **{name: Parameter(**_fields(Parameter, joint.get(name), filled=True)) for name in names},
            **kept,
        ),
    )


def _fields(model: type[Record], values: Mapping[str, Any] | None, *, filled: bool = False) -> dict[str, Any]:
    """Fields of a record that older JSON has; with quantiles made from mean and deviation where `filled`."""
    found = {name: values[name] for name in model.model_fields if name in values} if values else {}
    if filled and (known := interval_68(found)) is not None:
        found |= dict(zip(("q50", "q16", "q84"), known, strict=True))
    return found


def _flags_of_most(positions: Sequence[Position]) -> set[str]:
    """Flags that more than half of the positions have."""
    raised = [flag for one in positions for flag in one.flags.split(";") if flag]
    return {flag for flag in raised if raised.count(flag) > MOST * len(positions)}


def _distances(joint: JointTrack | None, positions: Iterable[Position]) -> tuple[float, float] | None:
    """Nearest and farthest source: of the track where that has a profile, otherwise of the positions."""
    if joint and joint.profile:
        found = [one.range_rsun.q50 for one in joint.profile if one.range_rsun.q50 is not None]
    elif joint and joint.tier == "preliminary":
        found = []
    else:
        found = [math.hypot(one.x_rsun, one.y_rsun, one.z_rsun) for one in positions if _is_usable(one)]
    known = [one for one in found if math.isfinite(one)]
    return (min(known), max(known)) if known else None


def placed_numbers(positions: Iterable[Position]) -> dict[str, float | None]:
    """Latitudes and area of an answer, from the positions that can be used."""
    usable = [one for one in positions if _is_usable(one)]
    off_plane = (one for one in usable if one.z_rsun != 0.0)
    latitudes = [math.degrees(math.atan2(one.z_rsun, math.hypot(one.x_rsun, one.y_rsun))) for one in off_plane]
    known = [one for one in latitudes if math.isfinite(one)]
    areas = [one.area68_rsun2 for one in usable if math.isfinite(one.area68_rsun2)]
    return {
        "latitude_low_deg": min(known, default=None),
        "latitude_high_deg": max(known, default=None),
        "area68_rsun2": statistics.median(areas) if areas else None,
    }


def _sides(positions: Iterable[Position]) -> str:
    """Where positions without a track are, in words; empty where they are in no one direction."""
    found = [math.degrees(math.atan2(one.y_rsun, one.x_rsun)) for one in positions if _is_usable(one)]
    known = [one for one in found if math.isfinite(one)]
    if not known:
        return ""
    off = [within_half_turn_deg(one - known[0]) for one in known]
    if max(off) - min(off) > ONE_DIRECTION_DEG:
        return ""
    ends = (_degrees(known[0] + one, 0) for one in (min(off), max(off)))
    said = " to ".join(dict.fromkeys(f"{number}°{side}" for number, side in ends))
    return f"position{'s' if len(known) > 1 else ''} at {said}"


def _is_usable(one: Position) -> bool:
    return not UNUSABLE_POSITION_FLAGS & set(one.flags.split(";"))


def _one_longitude(joint: JointTrack | None, flags: set[str]) -> tuple[float, float, float] | None:
    """Median and 68 % interval of the longitude, where it is one interval and not the prior's."""
    if joint is None or flags & NO_LONGITUDE or len(joint.phi0_68) > 1:
        return None
    found = _three(joint.phi0_deg)
    return None if joint.tier == "preliminary" else found


def _three(parameter: Parameter) -> tuple[float, float, float] | None:
    if parameter.q50 is None or parameter.q16 is None or parameter.q84 is None:
        return None
    return parameter.q50, parameter.q16, parameter.q84


def _wind(joint: JointTrack) -> tuple[float, float, float] | None:
    """Speed of the wind, where the times say more about it than the prior does."""
    speed, found = joint.v_sw_km_s, _three(joint.v_sw_km_s)
    is_prior = speed.contraction is not None and speed.contraction >= 1.0
    gap = wind_gap({"flags": joint.flags, "v_sw_km_s": speed.model_dump()})
    return None if is_prior or gap else found


def _grade(joint: JointTrack | None, longitude: tuple[float, float, float] | None, flags: set[str]) -> Grade:
    if joint is None or longitude is None:
        return "D"
    half_width = (longitude[2] - longitude[1]) / 2
    if half_width > GOOD_HALF_WIDTH_DEG or flags & SERIOUS_FLAGS:
        return "C"
    fits = joint.misfit_p is not None and MISFIT_TAIL <= joint.misfit_p <= 1 - MISFIT_TAIL
    return "A" if half_width <= BEST_HALF_WIDTH_DEG and fits and not flags - HARMLESS_FLAGS else "B"


def _where(
    joint: JointTrack | None,
    longitude: tuple[float, float, float] | None,
    parts: Sequence[Interval],
    flags: set[str],
) -> str:
    if joint is None:
        return "no track (none was fitted)"
    if longitude is not None:
        return _longitude_words(*longitude)
    if "not_one_source" in flags:
        return "no longitude to be used (the times are not those of one source)"
    if parts:
        each = " or ".join(f"{_span(one.low, one.high)} ({one.probability:.0%})".replace("%", " %") for one in parts)
        return each if joint.tier == "final" else f"preliminary: {each}"
    if joint.phi0_deg.q50 is None:
        return no_track(joint.flags)
    why = "several tracks explain the times" if "several_tracks" in flags else "the times leave it open"
    return f"no single longitude ({why})" if joint.tier == "final" else "preliminary: longitude not known"


def no_track(flags: Sequence[str]) -> str:
    """Words for a fit without a track: the first reason of its flags, without what follows from it."""
    said = next((FLAGS[flag] for flag in _WHY_NO_TRACK if flag in flags), "none was fitted").partition(":")[0]
    return f"no track ({said[0].lower() + said[1:].rstrip('.')})"


def _longitude_words(middle: float, low: float, high: float) -> str:
    digits = 0 if high - low >= 2 else 1
    number, side = _degrees(middle, digits)
    ends = [_degrees(one, digits) for one in (low, high)]
    if side and {its for _, its in ends} <= {side, ""}:
        near, far = sorted((one for one, _ in ends), key=float)
        return f"{number}°{side} ({near} to {far})"
    return f"{number}°{side} ({' to '.join(f'{one}{its}' for one, its in ends)})"


def _span(low: float, high: float) -> str:
    (first, its), (last, other) = (_degrees(one, 0) for one in (low, high))
    return f"{first}°{its} to {last}°{other}"


def _degrees(angle_deg: float, digits: int) -> tuple[str, str]:
    """Degrees without a sign, and the side of Earth with a blank before it; neither side at 0 and 180."""
    angle = within_half_turn_deg(angle_deg)
    number = f"{abs(angle):.{digits}f}"
    return number, "" if float(number) in {0.0, 180.0} else " W" if angle > 0 else " E"


def _distance_words(distances: tuple[float, float] | None) -> str:
    if distances is None:
        return "distance not known"
    return " to ".join(dict.fromkeys(f"{one:.0f}" for one in distances)) + " R_sun"


def _wind_words(
    joint: JointTrack | None,
    longitude: tuple[float, float, float] | None,
    wind: tuple[float, float, float] | None,
) -> list[str]:
    if joint is None or longitude is None:
        return []
    if wind is None:
        return [f"wind {NOT_MEASURED}"]
    middle, low, high = (f"{WIND_STEP_KM_S * round(one / WIND_STEP_KM_S):.0f}" for one in wind)
    return [f"wind {middle} km/s ({low} to {high})"]


def _named(name: str, unit: str, three: tuple[float, float, float] | None) -> dict[str, float]:
    """Fields of the answer for a median and its interval; none where it is not known."""
    if three is None:
        return {}
    return dict(zip((f"{name}_{unit}", f"{name}_low_{unit}", f"{name}_high_{unit}"), three, strict=True))

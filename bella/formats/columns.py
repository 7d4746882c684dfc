"""What the published tables hold: the name, kind, unit, UCD and meaning of every column, declared once.

All formats take their columns from here. Units are written as astropy and VOUnits read them, UCDs are words of UCD1+
(IVOA, doi:10.5479/ADS/bib/2018ivoa.spec.0527M). Positions are HEE, in solar radii; times are UTC.
"""

from dataclasses import dataclass
from typing import Literal

Kind = Literal["time", "float", "int", "bool", "text"]


@dataclass(frozen=True)
class Column:
    """One column of a published table.

    Attributes
    ----------
    name : str
        Carries the unit, as everywhere.
    kind : {"time", "float", "int", "bool", "text"}
        A time or a float may be unknown (NaT, NaN); a text that is unknown is empty.
    unit : str
        Empty for what has no unit.
    ucd : str
    description : str
    """

    name: str
    kind: Kind
    unit: str
    ucd: str
    description: str


@dataclass(frozen=True)
class Schema:
    """Columns of one published table, in order.

    Attributes
    ----------
    name : str
    title : str
    time : str
        Column that orders the rows in time.
    columns : tuple of Column
    """

    name: str
    title: str
    time: str
    columns: tuple[Column, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns in order."""
        return tuple(column.name for column in self.columns)

    def without(self, *names: str) -> "Schema":
        """The same table with fewer columns."""
        return Schema(self.name, self.title, self.time, tuple(one for one in self.columns if one.name not in names))


def _text(name: str, ucd: str, description: str) -> Column:
    return Column(name, "text", "", ucd, description)


def _time(name: str, ucd: str, description: str) -> Column:
    return Column(name, "time", "", ucd, description)


def _float(name: str, unit: str, ucd: str, description: str) -> Column:
    return Column(name, "float", unit, ucd, description)


SFU = "10**4 Jy"
"""The solar flux unit, 1e-22 W m-2 Hz-1, as VOUnits can say it: they do not know its name."""

BURST_ID = _text("burst_id", "meta.id", "Stable id of the burst.")
SOLUTION_ID = _text("solution_id", "meta.id", "Id of the solution, which never changes.")
OBSERVATORY = _text("observatory", "meta.id;instr.obsty", "Spacecraft that received the burst.")
GRADE = _text("grade", "meta.code.qual", "A (best) to D (no single answer).")
TIER = _text("tier", "meta.code.class", "final, or preliminary where two spacecraft received the burst.")
ORIGIN = _text(
    "origin", "meta.code.class", "Where the data come from: archive, event, submission, user, simulated, test."
)
F_LOW = _float("f_low_mhz", "MHz", "em.freq;stat.min", "Lowest frequency.")
F_HIGH = _float("f_high_mhz", "MHz", "em.freq;stat.max", "Highest frequency.")
FREQUENCY = _float("frequency_mhz", "MHz", "em.freq", "Frequency of the channel.")

_SERIES = (
    _text("edge", "meta.code", "Definition of the edge of a light curve that was timed."),
    _text("method", "meta.code", "Method of localisation."),
    _text("preset", "meta.code", "Named set of priors and errors."),
)


def _interval(name: str, unit: str, ucd: str, what: str) -> tuple[Column, ...]:
    """Median and the ends of the 68 % interval."""
    stem, _, tail = name.partition("@")
    end = f"_{tail}" if tail else ""
    return (
        _float(f"{stem}{end}", unit, f"{ucd};stat.median", f"{what}: median."),
        _float(f"{stem}_low{end}", unit, f"{ucd};stat.min", f"{what}: lower end of the 68 % interval."),
        _float(f"{stem}_high{end}", unit, f"{ucd};stat.max", f"{what}: upper end of the 68 % interval."),
    )


_PHI0 = _interval("phi0@deg", "deg", "pos.bodyrc.lon", "HEE longitude of the spiral at 1 solar radius, west positive")
_WIND = _interval("v_sw@km_s", "km/s", "phys.veloc", "Speed of the solar wind")

BURSTS = Schema(
    "bursts",
    "Type III bursts, preferred solutions",
    "start_utc",
    (
        BURST_ID,
        _time("start_utc", "time.start", "Onset at the highest frequency."),
        _time("end_utc", "time.end", "End at the lowest frequency."),
        F_LOW,
        F_HIGH,
        _text("observatories", "meta.id;instr.obsty", "Spacecraft that received the burst, separated by blanks."),
        GRADE,
        TIER,
        *_PHI0,
        _float("range_low_rsun", "solRad", "pos.distance;stat.min", "Distance of the nearest source from the Sun."),
        _float("range_high_rsun", "solRad", "pos.distance;stat.max", "Distance of the farthest source from the Sun."),
        _float("latitude_low_deg", "deg", "pos.bodyrc.lat;stat.min", "HEE latitude of the southernmost source."),
        _float("latitude_high_deg", "deg", "pos.bodyrc.lat;stat.max", "HEE latitude of the northernmost source."),
        _float("area68_rsun2", "solRad2", "phys.area", "Area of the 68 % region, median of all frequencies."),
        *_WIND,
        _text("flags", "meta.code.qual", "Quality flags of the preferred solution, separated by semicolons."),
        *_SERIES,
        Column("version", "int", "", "meta.version", "Version of the solution; 0 where there is none."),
        SOLUTION_ID,
        _time("created_utc", "time.creation", "When the solution was published."),
        _text("code_version", "meta.version;meta.software", "Version of the code that made the solution."),
        _text("sentence", "meta.note", "The answer in plain words."),
        _time("updated_utc", "time.creation", "When what is said of the burst was changed last."),
        ORIGIN,
        _text("retracted", "meta.note", "Why the burst was retracted; empty where it stands."),
    ),
)

_MATRIX = "stat.covariance"
_LOCALISATION = (
    FREQUENCY,
    _float("x_rsun", "solRad", "pos.cartesian.x;pos.heliocentric", "Apparent source, HEE x (to Earth)."),
    _float("y_rsun", "solRad", "pos.cartesian.y;pos.heliocentric", "Apparent source, HEE y (west)."),
    _float("z_rsun", "solRad", "pos.cartesian.z;pos.heliocentric", "Apparent source, HEE z (ecliptic north)."),
    _float("cov_xx_rsun2", "solRad2", _MATRIX, "Variance of x."),
    _float("cov_xy_rsun2", "solRad2", _MATRIX, "Covariance of x and y."),
    _float("cov_yy_rsun2", "solRad2", _MATRIX, "Variance of y."),
    _float("cov_xz_rsun2", "solRad2", _MATRIX, "Covariance of x and z; unknown for a source in the ecliptic."),
    _float("cov_yz_rsun2", "solRad2", _MATRIX, "Covariance of y and z; unknown for a source in the ecliptic."),
    _float("cov_zz_rsun2", "solRad2", _MATRIX, "Variance of z; unknown for a source in the ecliptic."),
    _float("area68_rsun2", "solRad2", "phys.area", "Area of the 68 % region (its section by the ecliptic)."),
    _float("area95_rsun2", "solRad2", "phys.area", "Area of the 95 % region (its section by the ecliptic)."),
    Column("modes", "int", "", "meta.number", "Separate parts of the 95 % region."),
    _time("emission_utc", "time.epoch", "When the wave left the source."),
    _float("v_over_c", "", "phys.veloc;arith.ratio", "Propagation speed over the speed of light."),
    _float("v_over_c_sd", "", "stat.stdev;phys.veloc", "Its standard deviation."),
    _float("contraction_x", "", "stat.error;arith.ratio", "Posterior over prior width of x."),
    _float("contraction_y", "", "stat.error;arith.ratio", "Posterior over prior width of y."),
    _float("contraction_v", "", "stat.error;arith.ratio", "Posterior over prior width of the propagation speed."),
    _float("log_evidence", "", "stat.likelihood", "Logarithm of the evidence of the channel."),
    _text("flags", "meta.code.qual", "Quality flags of the channel, separated by semicolons."),
)

LOCALISATIONS = Schema(
    "localisations",
    "Apparent source at each frequency",
    "emission_utc",
    (BURST_ID, *_LOCALISATION, *_SERIES, SOLUTION_ID),
)

TRACKS = Schema(
    "tracks",
    "Parker spiral of each burst, joint fit",
    "start_utc",
    (
        BURST_ID,
        _time("start_utc", "time.start", "Onset of the burst at the highest frequency."),
        GRADE,
        TIER,
        *_PHI0,
        *_WIND,
        *_interval("beam_speed@c", "", "phys.veloc;arith.ratio", "Speed of the beam along the field line over c"),
        _time("release_utc", "time.epoch", "When the beam left the Sun: median."),
        _float("release_sd_s", "s", "stat.stdev;time", "Standard deviation of that time."),
        _float("phi0_contraction", "", "stat.error;arith.ratio", "Posterior over prior width of the longitude."),
        _float("v_sw_contraction", "", "stat.error;arith.ratio", "Posterior over prior width of the wind speed."),
        _float("beam_speed_contraction", "", "stat.error;arith.ratio", "Posterior over prior width of the beam speed."),
        _float("misfit_p", "", "stat.probability", "Probability of a larger misfit, before errors are widened."),
        _float("rotation_period_d", "d", "time.period.rotation", "Rotation period of the Sun that the fit rests on."),
        _text("flags", "meta.code.qual", "Quality flags of the track, separated by semicolons."),
        *_SERIES,
        SOLUTION_ID,
    ),
)

DETECTIONS = Schema(
    "detections",
    "Bursts as each spacecraft received them",
    "start_utc",
    (
        OBSERVATORY,
        _time("start_utc", "time.start", "Onset at the highest frequency."),
        _time("peak_utc", "time.epoch", "Peak."),
        _time("end_utc", "time.end", "End at the lowest frequency."),
        F_LOW,
        F_HIGH,
        _float("score", "", "stat.snr", "Of the matched filter, in standard deviations of noise."),
        _float("drift", "", "phys.veloc;arith.ratio", "Speed over c of the beam whose drift fits best."),
        _float("peak_db", "dB", "phys.flux;arith.ratio", "Peak over background."),
        Column("channels", "int", "", "meta.number", "Channels in which it was seen."),
        Column("isolated", "bool", "", "meta.code", "Whether no other burst is near."),
        _text("tier", "meta.code.class", "localisable, catalogued or rejected."),
        _text("reason", "meta.note", "Why it is no more than that; empty where it was localised."),
        BURST_ID,
        ORIGIN,
        _float(
            "flux_sfu_1au",
            SFU,
            "phot.flux.density;em.radio;stat.max",
            "Largest flux density at 1 au, solar flux units.",
        ),
    ),
)

ARRIVALS = Schema(
    "arrivals",
    "Arrival times per spacecraft and channel",
    "arrival_utc",
    (
        BURST_ID,
        OBSERVATORY,
        FREQUENCY,
        _time("arrival_utc", "time.epoch", "When the edge arrived at the spacecraft."),
        _float("sigma_s", "s", "stat.stdev;time", "Error of the channel alone."),
        _text("edge", "meta.code", "Definition of the edge of a light curve that was timed."),
        _text("flag", "meta.code.qual", "Why the row was not used; empty where it was."),
        _float("x_rsun", "solRad", "pos.cartesian.x;pos.heliocentric", "Receiver, HEE x (to Earth)."),
        _float("y_rsun", "solRad", "pos.cartesian.y;pos.heliocentric", "Receiver, HEE y (west)."),
        _float("z_rsun", "solRad", "pos.cartesian.z;pos.heliocentric", "Receiver, HEE z (ecliptic north)."),
        _float("shape_sd_s", "s", "stat.stdev;time", "Error that is smooth along frequency within a spacecraft."),
        _float("offset_sd_s", "s", "stat.stdev;time", "Error that all channels of a spacecraft share."),
        _float("delay_s", "s", "time.interval", "Known delay beyond light travel."),
        _float("delay_sd_s", "s", "stat.stdev;time", "Error of that delay, smooth along frequency."),
        _float("rise_s", "s", "time.duration", "Half width of the rise."),
        SOLUTION_ID,
    ),
)

DAYS = Schema(
    "days",
    "What was searched, and the answer about each day",
    "day_utc",
    (
        _time("day_utc", "time.start", "Midnight at which the day begins."),
        ORIGIN,
        _text(
            "answer",
            "meta.code.class",
            "no data, archive silent, not searchable, no burst, not localisable, localised.",
        ),
        _text("reason", "meta.note", "Why, where it could not be searched, or not in all data sets."),
        _text("observatories", "meta.id;instr.obsty", "Spacecraft that were searched, separated by blanks."),
        Column("detections", "int", "", "meta.number", "Detections, those of one spacecraft alone too."),
        Column("rejected", "int", "", "meta.number", "Detections that were rejected."),
        Column("bursts", "int", "", "meta.number", "Bursts, seen by one spacecraft or more."),
        Column("shared", "int", "", "meta.number", "Bursts that two spacecraft or more received."),
        Column("localised", "int", "", "meta.number", "Bursts with a position."),
        _text("code_version", "meta.version;meta.software", "Version of the code that searched it."),
    ),
)

EVENTS = Schema(
    "events",
    "Events that others published, and the bursts that they are near to",
    "start_utc",
    (
        _text("event_id", "meta.id", "Source and the id that the event has there."),
        _text("kind", "meta.code.class", "flare, cme, particles (onset) or radio (a burst that others detected)."),
        _text("source", "meta.ref", "Who published it."),
        _text("published_id", "meta.id", "Its id there."),
        _text("observatory", "meta.id;instr.obsty", "Where it was seen from: EARTH, or a spacecraft."),
        _time("start_utc", "time.start", "Start, at the observer."),
        _time("peak_utc", "time.epoch", "Peak, at the observer."),
        _time("end_utc", "time.end", "End, at the observer."),
        _time("at_sun_utc", "time.start", "Start less the light travel from the Sun to the observer."),
        _text("size", "meta.code", "Class of a flare, speed of a CME, instruments that measured the particles."),
        _float("latitude_deg", "deg", "pos.bodyrc.lat", "Stonyhurst latitude, north positive."),
        _float("longitude_deg", "deg", "pos.bodyrc.lon", "Stonyhurst longitude, west positive."),
        F_LOW,
        F_HIGH,
        _text("link", "meta.ref.url", "Page about it."),
        BURST_ID,
        _float("delay_s", "s", "time.interval", "Start of the event less that of the burst, both at the Sun."),
        GRADE,
        *_PHI0,
        _float("range_low_rsun", "solRad", "pos.distance;stat.min", "Distance of the nearest source from the Sun."),
        _float("range_high_rsun", "solRad", "pos.distance;stat.max", "Distance of the farthest source from the Sun."),
        _text("sentence", "meta.note", "The answer about the burst in plain words."),
        SOLUTION_ID,
    ),
)

LATENCIES = Schema(
    "latency",
    "How long each solution took",
    "published_utc",
    (
        BURST_ID,
        SOLUTION_ID,
        ORIGIN,
        _time("published_utc", "time.creation", "When the solution could be read."),
        _time("data_utc", "time.end", "End of the burst."),
        _time("seen_utc", "time.epoch", "When the archive first listed the last of its files."),
        _time("fetched_utc", "time.epoch", "When the last of its files was in the mirror."),
        _time("detected_utc", "time.epoch", "When the search of its day had ended."),
        _float("data_to_published_s", "s", "time.interval", "From the end of the burst to the publication."),
        _float("seen_to_published_s", "s", "time.interval", "From the listing of the last file to the publication."),
        _float("fetched_to_published_s", "s", "time.interval", "From the mirror to the publication."),
        _float("detected_to_published_s", "s", "time.interval", "From the search to the publication."),
    ),
)

SCHEMAS = {schema.name: schema for schema in (BURSTS, LOCALISATIONS, TRACKS, DETECTIONS, ARRIVALS, DAYS, EVENTS)}
"""Published tables by name."""

SOLUTION_COLUMNS = tuple(column.name for column in _LOCALISATION)
"""Columns that a solution has at each frequency, in the order of the localisation table."""

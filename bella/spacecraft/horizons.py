"""Positions from JPL Horizons: the query, the answer, and what goes wrong between the two.

The service and its parameters are described at https://ssd-api.jpl.nasa.gov/doc/horizons.html. Asked for are geometric
vectors from the centre of the Sun in the ecliptic of J2000, in km, as comma-separated lines between ``$$SOE`` and
``$$EOE``. Their times are TDB.
"""

import re
import urllib.parse

import numpy as np
import numpy.typing as npt

from bella.exceptions import InputError, NoDataError, UnreachableError
from bella.spacecraft.encode import REFERENCE_UTC, Orbit
from bella.units import AU_KM, FloatArray

HORIZONS_IDS = {"EARTH": "399", "ACE": "-92", "STEREO-A": "-234", "PSP": "-96", "SOLO": "-144"}
"""Bodies that can be asked for. STEREO-B is not among them: after contact was lost its path is a guess."""

STEP_H = {"EARTH": 12}
DEFAULT_STEP_H = 3
TIMEOUT_S = 90.0
LARGEST_ANSWER = 50_000_000
FARTHEST_KM = 1.2 * AU_KM
FEWEST_NODES = 8


def vectors_query(body: str, start: np.datetime64, stop: np.datetime64) -> dict[str, str]:
    """Parameters of a query for positions.

    Parameters
    ----------
    body : str
        One of ``HORIZONS_IDS``.
    start, stop : numpy.datetime64
        First and last instant; taken as TDB, which is 69 s after UTC.

    Raises
    ------
    InputError
        If Horizons is not to be asked for that body.
    """
    if body not in HORIZONS_IDS:
        raise InputError(f"no trajectory of {body!r} to ask for: choose from {', '.join(HORIZONS_IDS)}")
    return {
        "format": "text",
        "COMMAND": f"'{HORIZONS_IDS[body]}'",
        "OBJ_DATA": "'NO'",
        "MAKE_EPHEM": "'YES'",
        "EPHEM_TYPE": "'VECTORS'",
        "CENTER": "'500@10'",
        "REF_PLANE": "'ECLIPTIC'",
        "REF_SYSTEM": "'ICRF'",
        "VEC_TABLE": "'1'",
        "VEC_CORR": "'NONE'",
        "OUT_UNITS": "'KM-S'",
        "TIME_TYPE": "'TDB'",
        "CSV_FORMAT": "'YES'",
        "START_TIME": f"'{_calendar(start)}'",
        "STOP_TIME": f"'{_calendar(stop)}'",
        "STEP_SIZE": f"'{STEP_H.get(body, DEFAULT_STEP_H)} h'",
    }


def _calendar(moment: np.datetime64) -> str:
    return str(np.datetime_as_string(moment, unit="m")).replace("T", " ")


def fetch_orbit(url: str, body: str, start: np.datetime64, stop: np.datetime64) -> Orbit:
    """Positions of a body from Horizons, as far as the service has them.

    Parameters
    ----------
    url : str
        Address of the service.
    body : str
        One of ``HORIZONS_IDS``.
    start, stop : numpy.datetime64
        First and last instant wanted. Where the service ends earlier, its end is taken.

    Returns
    -------
    Orbit
        Nodes 3 h apart (Earth: 12 h), UTC, km, ecliptic of J2000.

    Raises
    ------
    InputError
        If body or address is not one to ask.
    NoDataError
        If the service does not know the body, or has no positions of it in that time.
    UnreachableError
        If the service does not answer, or not with a table of vectors.
    """
    text = _answer(url, vectors_query(body, start, stop))
    end = _end_of_service(text)
    if end is not None and end < stop:
        if end - start < np.timedelta64(FEWEST_NODES * STEP_H.get(body, DEFAULT_STEP_H), "h"):
            raise NoDataError(f"Horizons has {body} only to {_calendar(end)[:10]}: ask again when it has more")
        text = _answer(url, vectors_query(body, start, end))
    return parse_vectors(text, body)


def _answer(url: str, query: dict[str, str]) -> str:
    if urllib.parse.urlsplit(url).scheme not in {"http", "https"}:
        raise InputError(f"{url!r} is no address of a service: set BELLA_HORIZONS_URL to one that begins with https://")
    import httpx  # noqa: PLC0415 - wanted here only, and positions are asked for by every command

    content = bytearray()
    try:
        with httpx.stream("GET", url, params=query, timeout=TIMEOUT_S, follow_redirects=True) as response:
            if response.status_code != httpx.codes.OK:
                raise UnreachableError(
                    f"Horizons refused the query with status {response.status_code}: try again later"
                )
            for piece in response.iter_bytes():
                content += piece
                if len(content) > LARGEST_ANSWER:
                    raise UnreachableError(f"the answer of {url} has no end: try again later")
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        raise UnreachableError(f"no answer from {url} ({error}): check the network, or try again later") from error
    return content.decode("utf-8", errors="replace")


def _end_of_service(text: str) -> np.datetime64 | None:
    """Last whole day the service says it has, where it says that it has no more."""
    found = re.search(r"No ephemeris for target .* after A\.D\. (\d{4})-([A-Z]{3})-(\d{2})", text, flags=re.IGNORECASE)
    if found is None:
        return None
    months = ["JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC"]
    year, month, day = found.groups()
    if month.upper() not in months:
        return None
    return np.datetime64(f"{year}-{months.index(month.upper()) + 1:02d}-{day}", "ns")


def parse_vectors(text: str, body: str) -> Orbit:
    """Positions in an answer of Horizons.

    Parameters
    ----------
    text : str
        The answer: comma-separated vectors in km, times in TDB.
    body : str
        What was asked for; named in errors.

    Returns
    -------
    Orbit
        Nodes of the answer, times in UTC.

    Raises
    ------
    NoDataError
        If the service says that it has no such body, or no positions of it in that time.
    UnreachableError
        If this is not a table of vectors with the columns, unit and frame that were asked for.
    """
    refusal = re.search(r"(No ephemeris for target .*|No matches found.*|Cannot find .*)", text)
    if refusal is not None:
        raise NoDataError(f"Horizons on {body}: {' '.join(refusal[1].split())}; ask for another time or body")
    table = re.search(r"^([^\n]*JDTDB[^\n]*)\n(?:\*+\s*\n)?\$\$SOE\s*\n(.*?)\n\$\$EOE", text, re.DOTALL | re.MULTILINE)
    if table is None or "KM-S" not in text or "Ecliptic of J2000" not in text:
        raise _malformed(body, "it holds no table of vectors in km in the ecliptic of J2000")
    names = [name.strip() for name in table[1].split(",")]
    if [name for name in ("JDTDB", "X", "Y", "Z") if name not in names]:
        raise _malformed(body, "columns JDTDB, X, Y, Z are not all there")
    columns = [names.index(name) for name in ("JDTDB", "X", "Y", "Z")]
    return _orbit(_numbers(table[2], columns, body), body)


def _numbers(lines: str, columns: list[int], body: str) -> FloatArray:
    try:
        rows = [[float(line.split(",")[column]) for column in columns] for line in lines.splitlines() if line.strip()]
    except (ValueError, IndexError) as error:
        raise _malformed(body, f"a line is not numbers ({error})") from error
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _orbit(rows: FloatArray, body: str) -> Orbit:
    """Nodes out of Julian days and positions, after a look at whether they can be true."""
    if len(rows) < FEWEST_NODES or not np.isfinite(rows).all() or not (np.diff(rows[:, 0]) > 0.0).all():
        raise _malformed(body, f"its {len(rows)} lines are too few, not finite, or not in order of time")
    distance_km = np.linalg.norm(rows[:, 1:], axis=1)
    if not (distance_km < FARTHEST_KM).all() or not (distance_km > 0.0).all():
        raise _malformed(body, f"a position is {distance_km.max():.3g} km from the Sun")
    return Orbit(_utc_ms(rows[:, 0]), rows[:, 1:])


def _utc_ms(julian_day_tdb: FloatArray) -> npt.NDArray[np.int64]:
    from astropy.time import Time  # noqa: PLC0415 - a second of import, wanted here only

    utc = Time(julian_day_tdb, format="jd", scale="tdb").utc.to_value("datetime64")
    return np.asarray(np.rint((utc - REFERENCE_UTC) / np.timedelta64(1, "ms")), dtype=np.int64)


def _malformed(body: str, reason: str) -> UnreachableError:
    return UnreachableError(f"the answer of Horizons about {body} cannot be used: {reason}; try again later")

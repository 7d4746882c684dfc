"""What the service takes from archives: names, folders, cadences and delays of data sets.

Names and folders are those of NASA's Space Physics Data Facility (SPDF); region summaries are those of NOAA's National
Centers for Environmental Information. Where the day of the first file is not known,
the row begins with the launch: asking for a day without a file is harmless, refusing a day that has one is not.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import date, timedelta
from typing import Literal

from bella.exceptions import InputError

DAY = timedelta(days=1)
WIND, STEREO, PSP, SOLO = date(1994, 11, 1), date(2006, 10, 26), date(2018, 8, 12), date(2020, 2, 10)
STEREO_B_LOST = date(2014, 9, 28)
SOLO_FLUX = date(2020, 6, 15)


@dataclass(frozen=True)
class Dataset:
    """A data set of an archive: one file per day, month or year.

    Attributes
    ----------
    key : str
        Name of the data set, as in CDAWeb.
    observatories : tuple of str
        Spacecraft that its files hold.
    name : str
        File name with ``{date}`` (YYYYMMDD) or ``{year}``, and ``{version}`` where files have one; upper and lower
        case are one.
    directories : tuple of str
        Folders below the root of the archive, with ``{year}`` and ``{month}``; more than one where the archive changed
        its mind.
    cadence_s : float
        Usual time between two spectra, s. Receivers change their mode: never take it for the time step of a file.
    latency_d : int
        Days after which a file is usually there.
    first, last : datetime.date or None
        Days of the first and the last file; None where the data set goes on.
    is_civil_day : bool
        False where a file does not run from midnight to midnight, so that a day needs its neighbours too.
    period : str
        What a file holds: a ``day``, a ``month`` (then ``{date}`` is its first day) or a ``year``. Files of months and
        years grow under one name.
    kind : str
        ``spectra``, ``in_situ`` (hourly speeds of the wind), ``regions`` (of the Sun) or ``events`` (such as flares).
    question : str
        Of what no folder lists but a service answers: its path and query, with the ``{first}`` and the ``{last}`` day
        of the period. Files then stand in the mirror under `name`, without a folder.
    """

    key: str
    observatories: tuple[str, ...]
    name: str
    directories: tuple[str, ...]
    cadence_s: float
    latency_d: int
    first: date
    last: date | None = None
    is_civil_day: bool = True
    period: Literal["day", "month", "year"] = "day"
    kind: Literal["spectra", "in_situ", "regions", "events"] = "spectra"
    question: str = ""

    def folders(self, day: date) -> tuple[str, ...]:
        """Folders that may hold the file of a day, relative to the root of the archive, without a slash at the end."""
        return tuple(directory.format(year=day.year, month=f"{day:%m}") for directory in self.directories)

    def span(self, day: date) -> tuple[date, date]:
        """First and last day of the period that a day is in."""
        if self.period == "day":
            return day, day
        first = day.replace(day=1) if self.period == "month" else day.replace(month=1, day=1)
        following = (first + 31 * DAY).replace(day=1) if self.period == "month" else first.replace(year=first.year + 1)
        return first, following - DAY

    def asked(self, day: date) -> str:
        """What a service is asked for about the period of a day."""
        first, last = self.span(day)
        return self.question.format(first=first, last=last)

    def file_name(self, day: date) -> str:
        """Name of the answer to `asked` in the mirror."""
        return self.name.format(date=f"{self.span(day)[0]:%Y%m%d}")

    def version(self, name: str, day: date) -> tuple[int, ...] | None:
        """Version of a file of a day.

        Parameters
        ----------
        name : str
            File name, without a folder.
        day : datetime.date
            Day the file should be of.

        Returns
        -------
        tuple of int or None
            Such as (2,) for ``_v02``, (0,) where names have no version; None if the name is not that of a file of this
            day.
        """
        before, *after = self.name.format(date=f"{self.span(day)[0]:%Y%m%d}", year=day.year, version="\0").split("\0")
        number = rf"(\d{{1,6}}(?:\.\d{{1,6}}){{0,3}}){re.escape(after[0])}" if after else "()"
        found = re.fullmatch(re.escape(before) + number, name, flags=re.IGNORECASE | re.ASCII)
        return tuple(int(part or 0) for part in found[1].split(".")) if found else None

    def covers(self, day: date) -> bool:
        """Whether the data set has this day, or will have it."""
        return self.first <= day and (self.last is None or day <= self.last)

    def due(self, day: date) -> date:
        """Day when the file of a day is usually there."""
        return day + (self.latency_d + 1) * DAY

    def neighbours(self, day: date) -> tuple[date, ...]:
        """Other days whose files hold a part of this one."""
        both = () if self.is_civil_day else (day - DAY, day + DAY)
        return tuple(other for other in both if self.covers(other))


def _wind(key: str, receiver: str, cadence_s: float, first: date) -> Dataset:
    # seen: the file of 2020-07-12 begins at 23:58:49 of the evening before, and that of 2020-07-11 ends at 23:55:00
    name, directory = f"wi_l2_wav_{receiver}_{{date}}_v{{version}}.cdf", f"pub/data/wind/waves/{receiver}_l2/{{year}}"
    return Dataset(key, ("WIND",), name, (directory,), cadence_s, 15, first, is_civil_day=False)


def _stereo(letter: str, receiver: str, last: date | None) -> Dataset:
    side, observatory = {"a": ("ahead", "STEREO-A"), "b": ("behind", "STEREO-B")}[letter]
    folder = f"pub/data/stereo/{side}/l3/waves/{receiver}"
    return Dataset(
        f"ST{letter}_L3_WAV_{receiver}".upper(),
        (observatory,),
        f"st{letter}_l3_wav_{receiver}_{{date}}_v{{version}}.cdf",
        (f"{folder}-direction-finding/{{year}}", f"{folder}/{{year}}"),  # the second until 2023
        38.05,
        30,
        STEREO,
        last,
    )


def _psp(level: str, receiver: str) -> Dataset:
    name = f"psp_fld_{level}_rfs_{receiver}_{{date}}_v{{version}}.cdf"
    directory = f"pub/data/psp/fields/{level}/rfs_{receiver}/{{year}}"
    # 7 s near the Sun, 56 s elsewhere; released orbit by orbit
    return Dataset(f"PSP_FLD_{level}_RFS_{receiver}".upper(), ("PSP",), name, (directory,), 56.0, 125, PSP)


def _solo(level: str, product: str, first: date, latency_d: int, cadence_s: float) -> Dataset:
    name, directory = (
        f"solo_{level}_rpw-{product}_{{date}}_v{{version}}.cdf",
        f"pub/data/solar-orbiter/rpw/science/{level}/{product}/{{year}}",
    )
    return Dataset(f"SOLO_{level}_RPW-{product}".upper(), ("SOLO",), name, (directory,), cadence_s, latency_d, first)


DATASETS = (
    Dataset(
        "WI_H1_WAV",
        ("WIND",),
        "wi_h1_wav_{date}_v{version}.cdf",
        ("pub/data/wind/waves/wav_h1/{year}",),
        60.0,
        15,
        WIND,
        date(2021, 11, 30),
    ),
    _wind("WI_L2_WAV_RAD1", "rad1", 17.0, date(1995, 9, 14)),
    _wind("WI_L2_WAV_RAD2", "rad2", 16.0, date(1994, 11, 12)),
    Dataset(
        "WI_K0_WAV",
        ("WIND",),
        "wi_k0_wav_{date}_v{version}.cdf",
        ("pub/data/wind/waves/wav_k0/{year}",),
        180.0,  # said to be minutes; not measured on a file
        1,
        WIND,
    ),
    Dataset(
        "WI_WA_RAD1_L3_DF",
        ("WIND",),
        "wi_wa_rad1_l3_df_{date}_v{version}.cdf",
        ("pub/data/wind/waves/rad1_l3_df/{year}",),
        183.26,
        90,  # not known; a guess on the late side
        WIND,
    ),
    Dataset(
        "STEREO_LEVEL2_SWAVES",
        ("STEREO-A", "STEREO-B"),
        "stereo_level2_swaves_{date}_v{version}.cdf",
        ("pub/data/stereo/combined/swaves/level2_cdf/{year}",),
        60.0,
        2,
        STEREO,
    ),
    _stereo("a", "lfr", None),
    _stereo("a", "hfr", None),
    _stereo("b", "lfr", STEREO_B_LOST),
    _stereo("b", "hfr", STEREO_B_LOST),
    _psp("l2", "lfr"),
    _psp("l2", "hfr"),
    _psp("l3", "lfr"),
    _psp("l3", "hfr"),
    # at SPDF level 2 of the HFR stops at 2023-11-13, but other mirrors go on
    _solo("l2", "hfr-surv", SOLO, 92, 17.0),
    _solo("l2", "tnr-surv", SOLO, 92, 17.0),
    _solo("l3", "hfr-surv-flux", SOLO_FLUX, 92, 17.0),
    _solo("l3", "tnr-surv-flux", SOLO_FLUX, 92, 17.0),
)
"""Every data set of spectra that the service can fetch."""


def _hourly(mission: str, observatory: str, directories: tuple[str, ...], latency_d: int, first: date) -> Dataset:
    """Hourly means of field and plasma, as COHOWeb merges them: one CDF file per month."""
    key = f"{mission}_COHO1HR_MERGED_MAG_PLASMA"
    name = f"{key.lower()}_{{date}}_v{{version}}.cdf"
    return Dataset(key, (observatory,), name, directories, 3600.0, latency_d, first, period="month", kind="in_situ")


def _donki(kind: str) -> Dataset:
    """Events of a month that CCMC's service DONKI knows; it needs no key at this address."""
    question = f"DONKI/WS/get/{kind}?startDate={{first}}&endDate={{last}}"
    name = f"DONKI-{kind}-{{date}}.json"
    return Dataset(
        f"DONKI_{kind}", (), name, (), 86_400.0, 1, date(2010, 4, 1), period="month", kind="events", question=question
    )


def _swpc(key: str, name: str, folder: str) -> Dataset:
    """A list of the newest days that SWPC replaces all the time, under one name."""
    question = f"{folder}/{name}"
    return Dataset(key, (), name, (), 60.0, 0, date(2020, 1, 1), period="year", kind="events", question=question)


COMPANIONS = (
    Dataset(
        "OMNI2_HOURLY",
        ("WIND",),
        "omni2_{year}.dat",
        ("pub/data/omni/low_res_omni",),
        3600.0,
        10,  # preliminary hours come about weekly
        WIND,
        period="year",
        kind="in_situ",
    ),
    # folder of PSP seen in public code; those of the others follow it, and are not verified
    _hourly("PSP", "PSP", ("pub/data/psp/coho1hr_magplasma/cdf/{year}",), 125, PSP),
    _hourly(
        "STA",
        "STEREO-A",
        ("pub/data/stereo/ahead/coho1hr_magplasma/cdf/{year}", "pub/data/stereo/ahead/coho1hr_magplasma/{year}"),
        60,
        STEREO,
    ),
    _hourly(
        "SOLO",
        "SOLO",
        ("pub/data/solar-orbiter/coho1hr_magplasma/cdf/{year}", "pub/data/solar-orbiter/coho1hr_magplasma/{year}"),
        120,
        SOLO,
    ),
    Dataset(
        "NOAA_SRS",
        (),
        "{date}SRS.txt",
        ("stp/space-weather/swpc-products/daily_reports/solar_region_summaries/{year}/{month}",),
        86_400.0,
        1,
        date(1996, 1, 2),
        kind="regions",
    ),
    Dataset(
        "NOAA_EVENTS",
        (),
        "{date}events.txt",
        ("stp/space-weather/swpc-products/daily_reports/solar_event_reports/{year}/{month}",),
        86_400.0,
        1,
        date(1996, 7, 31),
        kind="events",
    ),
    _swpc("SWPC_EDITED_EVENTS", "edited_events.json", "json"),
    _swpc("GOES_FLARES", "xray-flares-7-day.json", "json/goes/primary"),
    _donki("FLR"),
    _donki("CME"),
    _donki("SEP"),
)
"""What stands beside a track: hourly speeds of the wind, NOAA's summaries of active regions, and lists of events."""


def find_datasets(keys: Iterable[str]) -> tuple[Dataset, ...]:
    """Data sets by their keys.

    Parameters
    ----------
    keys : iterable of str
        Keys, upper or lower case; none for all data sets of spectra.

    Returns
    -------
    tuple of Dataset
        In the order asked for, each once.

    Raises
    ------
    InputError
        If there is no such data set.
    """
    known = {dataset.key: dataset for dataset in (*DATASETS, *COMPANIONS)}
    wanted = list(dict.fromkeys(key.strip().upper() for key in keys))
    unknown = [key for key in wanted if key not in known]
    if unknown:
        raise InputError(f"data set {unknown[0]!r} is not known; choose from {', '.join(known)}")
    return tuple(known[key] for key in wanted) or DATASETS

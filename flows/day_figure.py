"""The figure of a searched day. A day does not fail for its sake: what could not be drawn is drawn by a later run."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from datetime import date

import pandas as pd
import structlog
import xarray as xr

from bella.bursts.matched_filter import over_quiet
from bella.catalogue import Detection
from bella.exceptions import BellaError
from bella.plotting import write_day_png
from bella.settings import Settings
from flows.days import DayFiles, day_spectra

log = structlog.get_logger(__name__)

TIMES = ("start_utc", "peak_utc", "end_utc")


def draw_day(day: date, spectra: Sequence[xr.Dataset], found: Sequence[Detection], settings: Settings) -> bool:
    """Draw a day in place of what was drawn of it before.

    Parameters
    ----------
    day : datetime.date
    spectra : sequence of xarray.Dataset
        Over their background, one of each spacecraft.
    found : sequence of Detection
    settings : Settings

    Returns
    -------
    bool
        Whether it is drawn. If not, an earlier figure is gone too: it would not fit what is now known of the day.
    """
    path = settings.day_figure(day)
    try:
        write_day_png(path, day, spectra, detection_frame(found))
    except Exception as error:  # noqa: BLE001 - a picture is not worth a day, whatever keeps it from being drawn
        log.warning("figure of the day not drawn", reason=f"{type(error).__name__}: {error}")
        if path.is_file():
            path.unlink()
        return False
    return True


def redraw_day(files: DayFiles, found: Sequence[Detection], settings: Settings) -> bool:
    """Draw a day that was searched before, from its files and what was found in them.

    Parameters
    ----------
    files : DayFiles
    found : sequence of Detection
    settings : Settings

    Returns
    -------
    bool
        Whether it is drawn.
    """
    try:
        spectra = [over_quiet(one) for one in day_spectra(files).values()]
    except BellaError as error:
        log.warning("figure of the day not drawn", reason=str(error))
        return False
    return draw_day(files.day, spectra, found, settings)


def detection_frame(found: Iterable[Detection]) -> pd.DataFrame:
    """Detection table of records, with times as spectra have them: UTC without a zone.

    Parameters
    ----------
    found : iterable of Detection

    Returns
    -------
    pandas.DataFrame
    """
    table = pd.DataFrame([asdict(one) for one in found], columns=list(Detection.__dataclass_fields__))
    times = {name: pd.to_datetime(table[name], utc=True).dt.tz_localize(None) for name in TIMES}
    return table.assign(**times).astype(dict.fromkeys(TIMES, "datetime64[ns]"))

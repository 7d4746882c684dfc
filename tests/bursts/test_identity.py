import numpy as np
import pandas as pd
import pytest

from bella.bursts import burst_id, onset
from bella.exceptions import InputError


def arrivals(*rows: tuple[float, str | None]) -> pd.DataFrame:
    frame = pd.DataFrame(rows, columns=["frequency_mhz", "arrival_utc"])
    return frame.assign(arrival_utc=pd.to_datetime(frame["arrival_utc"], format="ISO8601"))


def test_a_burst_is_named_after_its_first_arrival_at_the_highest_frequency() -> None:
    table = arrivals(
        (0.2, "2012-06-07T19:20"), (2.0, "2012-06-07T19:30:10"), (2.0, "2012-06-07T19:29:59.9"), (3.0, None)
    )

    assert onset(table) == np.datetime64("2012-06-07T19:29:59.900")
    assert burst_id(onset(table)) == "T3-20120607-1929"


def test_a_table_without_arrival_times_names_no_burst() -> None:
    with pytest.raises(InputError, match="no arrival time"):
        onset(arrivals((2.0, None)))


def test_no_onset_no_name() -> None:
    with pytest.raises(InputError, match="without onset"):
        burst_id(np.datetime64("NaT"))

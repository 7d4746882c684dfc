"""Times of a CDF become UTC, and fill values no time."""

import numpy as np
import pytest

from bella.containers import utc_of_cdf_epoch, utc_of_cdf_epoch16, utc_of_tt2000

SECOND = np.timedelta64(10**9, "ns")


@pytest.mark.parametrize(
    ("tt", "utc", "ahead_s"),
    [
        ("2012-06-07T19:30:00", "2012-06-07T19:28:53.816", 66.184),
        ("2020-07-21T03:00:00", "2020-07-21T02:58:50.816", 69.184),
        ("2017-01-01T00:01:09.184", "2017-01-01T00:00:00", 69.184),
        ("2016-12-31T23:59:00", "2016-12-31T23:57:51.816", 68.184),
    ],
)
def test_tt2000_becomes_utc_by_the_table_of_leap_seconds(tt: str, utc: str, ahead_s: float) -> None:
    stored = (np.datetime64(tt, "ns") - np.datetime64("2000-01-01T12:00:00", "ns")).astype(np.int64)

    read = utc_of_tt2000(np.array([stored]))[0]

    assert read == np.datetime64(utc, "ns")
    assert (np.datetime64(tt, "ns") - read) / SECOND == pytest.approx(ahead_s, abs=1e-9)


def test_cdf_epoch_knows_no_leap_seconds() -> None:
    # 734 154 days of 86 400 000 ms, by the proleptic calendar
    assert str(utc_of_cdf_epoch(np.array([63_430_905_600_000.0]))[0]) == "2010-01-17T00:00:00.000000000"


def test_a_fill_value_is_no_time() -> None:
    assert np.isnat(utc_of_tt2000(np.array([np.iinfo(np.int64).min]))).all()
    assert np.isnat(utc_of_cdf_epoch(np.array([-1e31, np.nan, 0.0]))).all()


def test_cdf_epoch16_has_nanoseconds() -> None:
    # of 2020-07-11 00:00:30.123456789, by compute_epoch16 of cdflib
    read = utc_of_cdf_epoch16(np.array([63_761_644_830.0 + 123_456_789_000.0j]))

    assert str(read[0]) == "2020-07-11T00:00:30.123456789"


@pytest.mark.parametrize("stored", [-1e31 - 1e31j, 0.0 + 0.0j, 63_761_644_830.0 + 1e12j, 63_761_644_830.5 + 0.0j])
def test_what_no_clock_shows_is_no_time(stored: complex) -> None:
    assert np.isnat(utc_of_cdf_epoch16(np.array([stored]))).all()

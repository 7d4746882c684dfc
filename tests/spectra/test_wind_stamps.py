"""Whether the minutes of Wind are where their stamps say: its light curves against those of STEREO-A and PSP."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import xarray as xr

from bella.spacecraft import light_time_s
from bella.spectra import open_spectra, sample_times
from tests.spectra import real_day_2020

RAD1_MHZ, RAD2_MHZ, NEAR_THE_SUN_MHZ = (0.66, 1.06), (1.06, 2.1), (3.0, 9.0)
RANGE_RSUN_MHZ = 30.0
"""Distance of a source times its frequency, as in the event of 2012-06-07.

Half or one and a half times as much changes the light's way at 1 to 2 MHz by 4 s between Wind and PSP, and by 5 s
between Wind and STEREO-A.
"""

FASTEST_S = 140.0
LEAST_COHERENCE = 0.85
FEWEST = 8


Window = tuple[np.datetime64, np.datetime64]


class Received(NamedTuple):
    """A burst: when to look, and about which HEE longitude its source was."""

    begin: str
    end: str
    longitude_deg: float

    @property
    def window(self) -> Window:
        return np.datetime64(self.begin, "ns"), np.datetime64(self.end, "ns")

    def light_s(self, observatory: str, mhz: float) -> float:
        """Way of the light from the source."""
        longitude = np.radians(self.longitude_deg)
        point = RANGE_RSUN_MHZ / mhz * np.array([np.cos(longitude), np.sin(longitude), 0.0])
        return float(light_time_s(observatory, self.window[0], point)[0])


FAR_SIDE = (
    Received("2020-07-21T02:47", "2020-07-21T03:10", 160.0),
    Received("2020-07-21T06:58", "2020-07-21T07:16", 160.0),
    Received("2020-07-21T07:14", "2020-07-21T07:40", 160.0),
)
WEST = Received("2010-01-17T17:42", "2010-01-17T17:54", 50.0)


class LightCurve(NamedTuple):
    """Power over the quiet level in one channel, and when."""

    second: np.ndarray
    power: np.ndarray

    def components(self, angular: np.ndarray, length_s: float) -> np.ndarray:
        """Fourier components, every sample weighted with the time it stands for."""
        weight = np.gradient(self.second) * np.sqrt(np.sin(np.pi * np.clip(self.second / length_s, 0.0, 1.0)))
        over = np.log1p(np.maximum(self.power - np.percentile(self.power, 10), -0.5))
        return np.asarray((over * weight) @ np.exp(-1j * np.outer(self.second, angular)))


def light_curve(spectrum: xr.Dataset, channel: int, window: Window) -> LightCurve:
    values = spectrum["intensity"].to_numpy()[:, channel].astype(np.float64)
    power = {"voltage_ratio": values**2, "db_over_background": 10.0 ** (values / 10.0)}.get(spectrum.quantity, values)
    time = sample_times(spectrum).to_numpy()[:, channel]
    known = np.isfinite(power) & (time >= window[0]) & (time <= window[1])
    quiet = np.median(power[np.isfinite(power)]) if known.sum() >= FEWEST else 1.0
    return LightCurve((time[known] - window[0]) / np.timedelta64(1, "s"), power[known] / quiet)


def later_s(one: LightCurve, other: LightCurve, length_s: float) -> float:
    """How much later one light curve is than the other, by slow Fourier components; NaN where they are not alike."""
    if min(one.second.size, other.second.size) < FEWEST:
        return np.nan
    angular = 2.0 * np.pi * np.arange(1, int(length_s / FASTEST_S) + 1) / length_s
    first, second = (curve.components(angular, length_s) for curve in (one, other))
    lags = np.arange(-180.0, 180.5, 0.5)
    alike = np.real(np.exp(-1j * np.outer(lags, angular)) @ (second * first.conj()))
    coherence = alike.max() / np.sqrt((np.abs(first) ** 2).sum() * (np.abs(second) ** 2).sum())
    return float(lags[alike.argmax()]) if coherence > LEAST_COHERENCE else np.nan


def unexplained_s(wind: xr.Dataset, other: xr.Dataset, burst: Received, band_mhz: tuple[float, float]) -> float:
    """What Wind is later than another spacecraft beyond the light's way, median of the channels."""
    length_s = (burst.window[1] - burst.window[0]) / np.timedelta64(1, "s")
    mhz, there_mhz = wind["frequency"].to_numpy(), other["frequency"].to_numpy()
    found = []
    for channel in np.flatnonzero((mhz > band_mhz[0]) & (mhz < band_mhz[1]) & ~wind["interpolated"].to_numpy()):
        there = int(np.abs(there_mhz - mhz[channel]).argmin())
        curves = (light_curve(wind, int(channel), burst.window), light_curve(other, there, burst.window))
        way_s = [burst.light_s(str(one.attrs["observatory"]), mhz[channel]) for one in (wind, other)]
        found.append(later_s(*curves, length_s) - (way_s[0] - way_s[1]))
    return float(np.nanmedian(found))


@pytest.fixture(scope="module")
def wind(reference_files: Path) -> xr.Dataset:
    return real_day_2020.wind(reference_files)


@pytest.fixture(scope="module")
def others(reference_files: Path) -> list[xr.Dataset]:
    return [real_day_2020.psp(reference_files), real_day_2020.stereo_a(reference_files)]


@pytest.mark.parametrize("band_mhz", [RAD1_MHZ, RAD2_MHZ])
def test_wind_is_where_light_puts_it(wind: xr.Dataset, others: list[xr.Dataset], band_mhz: tuple[float, float]) -> None:
    """Were the stamps beginnings of minutes, it would be 30 s early; were they ends, 30 s late."""
    found_s = np.array([[unexplained_s(wind, one, burst, band_mhz) for burst in FAR_SIDE] for one in others])

    assert np.abs(found_s.mean(axis=1)).max() < 12.0
    assert found_s.std(axis=1).max() < 8.0


def test_both_receivers_have_one_clock(wind: xr.Dataset, others: list[xr.Dataset]) -> None:
    apart_s = [
        unexplained_s(wind, one, burst, RAD1_MHZ) - unexplained_s(wind, one, burst, RAD2_MHZ)
        for one in others
        for burst in FAR_SIDE
    ]

    assert abs(np.mean(apart_s)) < 12.0


def test_the_reader_puts_minutes_where_light_does(reference_files: Path) -> None:
    _, rad2, _ = open_spectra(reference_files / "semp/wi_h1_wav_20100117_v01.cdf")
    stereo_a, _ = open_spectra(reference_files / "semp/stereo_level2_swaves_20100117_v01.cdf")

    assert abs(unexplained_s(rad2, stereo_a, WEST, NEAR_THE_SUN_MHZ)) < 15.0

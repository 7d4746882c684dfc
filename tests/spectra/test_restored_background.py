"""Fluxes that were published with their background taken away get one back, and nothing else does."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest
import xarray as xr

from bella.simulation.burst import SimulatedBurst
from bella.simulation.day import observe_day
from bella.simulation.instruments import Instrument, instruments
from bella.simulation.sky import Conditions, Sky
from bella.spectra import decibels, over_background

DAY = date(2021, 2, 10)
BURST = SimulatedBurst(np.datetime64("2021-02-10T05:00", "ns"), f_low_mhz=0.2, f_high_mhz=12.0, contrast=100.0)
DATASETS = ("STA_L3_WAV_HFR", "SOLO_L3_RPW-HFR-SURV-FLUX")


def observed(instrument: Instrument) -> xr.Dataset:
    sky = Sky(DAY, (BURST,), (), {instrument.receiver.observatory: Conditions()})
    return observe_day(instrument, [sky], DAY, np.random.default_rng(1))


@pytest.fixture(scope="module", params=DATASETS)
def pair(request: pytest.FixtureRequest) -> tuple[xr.Dataset, xr.Dataset]:
    """A day as flux without its background, and the same with it."""
    (instrument,) = instruments(request.param, DAY)
    return observed(instrument), observed(replace(instrument, quantity="psd_v2_hz"))


def test_quiet_samples_are_at_zero(pair: tuple[xr.Dataset, xr.Dataset]) -> None:
    flux, power = pair
    assert (flux["intensity"] < 0).mean() > 0.3

    for spectrum in (flux, power):
        quiet = over_background(spectrum)["intensity"].to_numpy()[:400]
        assert np.abs(np.nanmedian(quiet, axis=0)).max() < 0.1
        assert np.nanmedian(np.nanstd(quiet, axis=0)) == pytest.approx(0.22, abs=0.05)  # 5 % in dB


def test_a_burst_is_as_high_as_with_the_background_that_there_was(pair: tuple[xr.Dataset, xr.Dataset]) -> None:
    flux, power = (over_background(one)["intensity"].to_numpy().max(axis=0) for one in pair)
    is_high = power > 6.0

    assert is_high.sum() > 20
    np.testing.assert_allclose(flux[is_high], power[is_high], atol=1.0)


def test_a_flux_with_its_background_is_left_alone(pair: tuple[xr.Dataset, xr.Dataset]) -> None:
    power = pair[1]
    expected = 10 * np.log10(power["intensity"].to_numpy().astype(np.float64))

    np.testing.assert_array_equal(decibels(power.assign_attrs(quantity="flux_w_m2_hz")), expected)


@pytest.mark.parametrize("quantity", ["psd_v2_hz", "voltage_ratio", "relative_flux"])
def test_other_quantities_are_left_alone(pair: tuple[xr.Dataset, xr.Dataset], quantity: str) -> None:
    flux = pair[0]
    found = decibels(flux.assign_attrs(quantity=quantity))

    np.testing.assert_array_equal(np.isnan(found), ~(flux["intensity"].to_numpy() > 0.0))


def test_only_the_channels_that_need_it_get_a_background(pair: tuple[xr.Dataset, xr.Dataset]) -> None:
    flux, power = pair
    mixed = flux["intensity"].to_numpy().copy()
    mixed[:, :5] = power["intensity"].to_numpy()[:, :5]
    found = decibels(flux.assign(intensity=(("time", "frequency"), mixed)))

    np.testing.assert_array_equal(found[:, :5], 10 * np.log10(mixed[:, :5].astype(np.float64)))
    np.testing.assert_array_equal(found[:, 5:], decibels(flux)[:, 5:])


def test_channels_without_data_stay_without(pair: tuple[xr.Dataset, xr.Dataset]) -> None:
    flux = pair[0]
    dead = flux["intensity"].to_numpy().copy()
    dead[:, 3] = np.nan
    dead[:, 4] = 0.0
    found = decibels(flux.assign(intensity=(("time", "frequency"), dead)))

    assert np.isnan(found[:, 3:5]).all()

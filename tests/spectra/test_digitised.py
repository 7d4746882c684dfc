from importlib import resources
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bella.spectra import event_spectra, relative_power, validate_spectrum

SOURCES = {"WIND": "wind", "STEREO-A": "sta", "STEREO-B": "stb"}


def decay_s(power: np.ndarray, time_s: np.ndarray) -> float:
    """E-folding time between 70 and 10 % of the maximum."""
    decay = power[power.argmax() :]
    part = slice(int((decay < 0.7).argmax()), int((decay < 0.1).argmax()))
    return float(-1.0 / np.polyfit(time_s[: decay.size][part], np.log(decay[part]), 1)[0])


def test_the_event_has_three_spectra_of_the_right_form() -> None:
    spectra = event_spectra()

    assert set(spectra.children) == set(SOURCES)
    for name, child in spectra.children.items():
        validate_spectrum(child.to_dataset(), name)
        assert child.attrs["observatory"] == name
        assert child.attrs["quantity"] == "relative_flux"
        assert child["intensity"].dtype == np.float32
        np.testing.assert_array_equal(child["intensity"].max("time"), 1.0)


@pytest.mark.parametrize(("observatory", "source"), SOURCES.items())
def test_the_values_are_those_read_off_the_figure(observatory: str, source: str, reference_files: Path) -> None:
    ours = event_spectra()[observatory].to_dataset()
    with xr.open_dataset(reference_files / "event_2012-06-07" / f"{source}_relative_flux.nc") as theirs:
        np.testing.assert_allclose(ours["intensity"], theirs["relative_flux"], atol=1e-6)
        np.testing.assert_allclose(ours["frequency"], theirs["frequency"], rtol=1e-6)
        assert np.abs(ours["time"].to_numpy() - theirs["time"].to_numpy()).max() < np.timedelta64(2, "ms")


def test_the_spectra_are_small() -> None:
    assert len((resources.files("bella.spectra") / "event_2012-06-07.nc").read_bytes()) < 60_000


@pytest.mark.parametrize("frequency_mhz", [0.4, 0.6])
def test_wind_shows_an_amplitude_and_stereo_a_power(frequency_mhz: float) -> None:
    decay = {}
    for name, child in event_spectra().children.items():
        nearby = np.abs(np.log(child["frequency"].to_numpy() / frequency_mhz)) < 0.12
        power = relative_power(child.to_dataset()).to_numpy()[:, nearby].T
        time_s = np.arange(child.sizes["time"]) * child.attrs["integration_s"]
        decay[name] = np.median([decay_s(channel, time_s) for channel in power])

    stereo_s = (decay["STEREO-A"] + decay["STEREO-B"]) / 2.0
    assert decay["WIND"] == pytest.approx(stereo_s, rel=0.25)
    assert decay["WIND"] * 2.0 > 1.5 * stereo_s


def test_the_caller_may_change_what_it_got() -> None:
    event_spectra()["WIND"]["intensity"][:] = 0.0

    assert event_spectra()["WIND"]["intensity"].max() == 1.0

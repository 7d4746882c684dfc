from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from bella.exceptions import InputError
from bella.spectra import light_curve, relative_power, sample_times, validate_spectrum


def spectrum(**attributes: object) -> xr.Dataset:
    intensity = np.array([[0.0, 1.0, 2.0], [3.0, 4.0, np.nan]], dtype=np.float32)
    return xr.Dataset(
        {"intensity": (("time", "frequency"), intensity)},
        coords={
            "time": np.array(["2012-06-07T19:30:00", "2012-06-07T19:31:00"], "datetime64[ns]"),
            "frequency": [0.5, 1.0, 1.5],
        },
        attrs={
            "observatory": "WIND",
            "receiver": "RAD1",
            "quantity": "voltage_ratio",
            "integration_s": 60.0,
            "source_files": "a.cdf",
            **attributes,
        },
    )


def test_a_spectrum_of_the_right_form_is_handed_back() -> None:
    good = spectrum()

    assert validate_spectrum(good, "x.nc") is good


def test_a_spectrum_stays_one_through_a_netcdf_file(tmp_path: Path) -> None:
    spectrum(source_files=["a.cdf", "b.cdf"]).assign(interpolated=("frequency", [True, False, False])).to_netcdf(
        tmp_path / "s.nc", engine="h5netcdf"
    )

    with xr.open_dataset(tmp_path / "s.nc", engine="h5netcdf") as again:
        assert validate_spectrum(again, "s.nc").sizes == {"time": 2, "frequency": 3}


@pytest.mark.parametrize("name", ["observatory", "receiver", "quantity", "integration_s", "source_files"])
def test_a_missing_attribute_is_named(name: str) -> None:
    bad = spectrum()
    del bad.attrs[name]

    with pytest.raises(InputError, match=rf"x\.nc is not a dynamic spectrum: add the attribute '{name}'"):
        validate_spectrum(bad, "x.nc")


@pytest.mark.parametrize(
    ("bad", "complaint"),
    [
        (spectrum(observatory=" "), "observatory"),
        (spectrum(quantity="jansky"), r"'jansky': use one of db_over"),
        (spectrum(integration_s=0.0), "integration_s.*above zero"),
        (spectrum(integration_s="a minute"), "integration_s.*above zero"),
        (spectrum(power_exponent=-1), "power_exponent"),
        (spectrum().drop_vars("frequency"), "coordinate 'frequency'"),
        (spectrum().rename(time="epoch"), "coordinate 'time'"),
        (spectrum().assign_coords(time=[0.0, 60.0]), "CF time units"),
        (spectrum().assign_coords(frequency=["low", "mid", "high"]), "give MHz"),
        (spectrum().assign_coords(frequency=("frequency", [500.0, 1000.0, 1500.0], {"units": "kHz"})), "in kHz"),
        (spectrum().isel(time=[1, 0]), "'time' does not ascend"),
        (spectrum().isel(frequency=[0, 0, 1]), "'frequency' does not ascend"),
        (spectrum().assign_coords(frequency=[0.0, 1.0, 1.5]), "from above zero"),
        (spectrum().assign_coords(frequency=[0.5, 1.0, np.nan]), "'frequency' does not ascend"),
        (spectrum().isel(time=[0]), "1 records of 3 channels"),
        (spectrum().rename(intensity="flux"), r"values 'intensity' \(one of flux\)"),
        (spectrum().assign(intensity=(("time", "frequency"), np.zeros((2, 3), dtype=int))), "int64: use float32"),
        (spectrum().transpose("frequency", "time"), "order them"),
        (spectrum().assign(sample_offset_s=("time", [0.0, 1.0])), "sample_offset_s"),
        (spectrum().assign(position_km=("time", [0.0, 1.0])), "position_km"),
        (spectrum().assign(position_km=(("time", "axis"), np.ones((2, 2)), {"frame": "hee"})), "2 columns of float64"),
        (spectrum().assign(position_km=(("time", "axis"), np.ones((2, 3)))), "frame None: use one of hee"),
        (
            spectrum().assign(position_km=(("time", "axis"), np.ones((2, 3)), {"frame": "HCI", "units": "m"})),
            "in m: convert it to km",
        ),
    ],
)
def test_what_is_wrong_is_named(bad: xr.Dataset, complaint: str) -> None:
    with pytest.raises(InputError, match=complaint) as refused:
        validate_spectrum(bad, "x.nc")

    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("attributes", "expected"),
    [
        ({"quantity": "voltage_ratio"}, [9.0, 16.0]),
        ({"quantity": "relative_flux"}, [3.0, 4.0]),
        ({"quantity": "relative_flux", "power_exponent": 2.0}, [9.0, 16.0]),
        ({"quantity": "flux_w_m2_hz"}, [3.0, 4.0]),
        ({"quantity": "db_over_background"}, [10**0.3, 10**0.4]),
    ],
)
def test_every_quantity_becomes_a_power(attributes: dict[str, object], expected: list[float]) -> None:
    power = relative_power(spectrum(**attributes))

    np.testing.assert_allclose(power.to_numpy()[1, :2], expected)
    assert np.isnan(power.to_numpy()[1, 2])


def test_samples_are_taken_when_the_sweep_passes() -> None:
    swept = spectrum().assign(sample_offset_s=("frequency", [-1.5, 0.0, 2.0]))

    offsets = (sample_times(swept) - swept["time"]).to_numpy() / np.timedelta64(1, "s")

    np.testing.assert_array_equal(offsets, [[-1.5, 0.0, 2.0]] * 2)
    np.testing.assert_array_equal(sample_times(spectrum()).isel(frequency=0), spectrum()["time"])


def test_times_given_per_sample_win() -> None:
    times = spectrum()["time"] + xr.DataArray(np.array([1, 2, 3], "timedelta64[s]"), dims="frequency")

    np.testing.assert_array_equal(sample_times(spectrum().assign(sample_time=times)), times)


def test_a_light_curve_is_the_power_of_the_nearest_channel_at_its_own_times() -> None:
    curve = light_curve(spectrum().assign(sample_offset_s=("frequency", [0.0, 10.0, 0.0])), 0.9)

    np.testing.assert_array_equal(curve, [1.0, 16.0])
    assert curve["frequency"] == 1.0
    assert curve["time"][0] == np.datetime64("2012-06-07T19:30:10")


def test_a_frequency_the_receiver_does_not_reach_is_refused() -> None:
    with pytest.raises(InputError, match=r"no channel at 3 MHz: choose from 0\.5 to 1\.5 MHz"):
        light_curve(spectrum(), 3.0)

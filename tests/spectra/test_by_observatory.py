"""One spectrum per spacecraft: receivers together, days in a row, the best of several products."""

import numpy as np
import pytest
import xarray as xr

from bella.exceptions import InputError
from bella.spectra.assembly import Origin, assemble
from bella.spectra.combination import by_observatory

START = np.datetime64("2020-07-21", "ns")
LOW, HIGH = (0.1, 0.2, 0.4), (1.0, 2.0, 4.0)


def spectrum(
    observatory: str = "PSP",
    receiver: str = "LFR",
    quantity: str = "psd_v2_hz",
    mhz: tuple[float, ...] = LOW,
    *,
    cadence_s: float = 60.0,
    day: int = 0,
) -> xr.Dataset:
    time = START + np.timedelta64(day, "D") + (np.arange(20) * cadence_s * 1e9).astype("timedelta64[ns]")
    intensity = np.ones((20, len(mhz)), dtype=np.float32)
    return assemble(Origin(observatory, receiver, quantity, f"{receiver}{day}"), time, np.array(mhz), intensity, {})


def test_receivers_of_a_spacecraft_come_together() -> None:
    found = by_observatory([spectrum(receiver="HFR", mhz=HIGH), spectrum(), spectrum("WIND", "RAD1")])

    assert list(found) == ["PSP", "WIND"]
    np.testing.assert_array_equal(found["PSP"]["frequency"], [*LOW, *HIGH])


def test_days_in_any_order_are_joined() -> None:
    parts = [
        spectrum(receiver=name, mhz=band, day=day) for day in (1, 0) for name, band in (("LFR", LOW), ("HFR", HIGH))
    ]
    found = by_observatory(parts)["PSP"]

    assert found.sizes == {"time": 40, "frequency": 6}
    assert np.isfinite(found["intensity"]).all()
    assert (np.diff(found["time"].to_numpy()) > np.timedelta64(0, "s")).all()


def test_of_two_products_the_finer_cadence_is_taken() -> None:
    coarse = spectrum("STEREO-A", "SWAVES", "db_over_background", (*LOW, *HIGH), cadence_s=60.0)
    fine = spectrum("STEREO-A", "HFR", "flux_w_m2_hz", HIGH, cadence_s=38.05)

    for parts in ([coarse, fine], [fine, coarse]):
        assert by_observatory(parts)["STEREO-A"].attrs["quantity"] == "flux_w_m2_hz"


def test_of_equal_cadence_the_product_with_more_channels_is_taken() -> None:
    few = spectrum("WIND", "RAD1", "voltage_ratio")
    many = spectrum("WIND", "RAD2", "psd_v2_hz", (*HIGH, 8.0))

    for parts in ([few, many], [many, few]):
        assert by_observatory(parts)["WIND"].attrs["quantity"] == "psd_v2_hz"


def test_the_thermal_noise_receiver_is_left_out() -> None:
    found = by_observatory([spectrum("WIND", "TNR"), spectrum("WIND", "RAD1", mhz=HIGH)])

    assert found["WIND"].attrs["receiver"] == "RAD1"


@pytest.mark.parametrize("nothing", [[], ["TNR"]], ids=["none", "thermal_noise_only"])
def test_nothing_to_search_is_told(nothing: list[str]) -> None:
    with pytest.raises(InputError, match="name files of at least one receiver"):
        by_observatory([spectrum("WIND", name) for name in nothing])

"""Dynamic spectra as spectrograms of radiospectra and back, and e-CALLISTO FITS through them."""

from pathlib import Path

import astropy.units as u
import numpy as np
import pytest
from astropy.io import fits

from bella.exceptions import InputError
from bella.spectra import from_radiospectra, open_spectra, to_radiospectra, validate_spectrum
from bella.spectra.assembly import Origin, assemble

spectrogram = pytest.importorskip("radiospectra.spectrogram")

TIME = np.datetime64("2012-06-07T19:00", "ns") + np.arange(90) * np.timedelta64(38_500, "ms")
MHZ = np.geomspace(0.125, 16.0, 12)
FLUX = np.random.default_rng(1).gamma(9.0, 1e-20, (90, 12)).astype(np.float32)


def test_there_and_back() -> None:
    spectrum = assemble(Origin("STEREO-A", "HFR", "flux_w_m2_hz", "sta.cdf"), TIME, MHZ, FLUX)

    there = to_radiospectra(spectrum)
    back = from_radiospectra(there, "flux_w_m2_hz")

    assert there.data.shape == (12, 90)
    np.testing.assert_allclose(there.frequencies.to_value("kHz"), MHZ * 1e3)
    assert (back.attrs["observatory"], back.attrs["receiver"]) == ("STEREO-A", "HFR")
    assert back.attrs["source_files"] == ["sta.cdf"]
    np.testing.assert_array_equal(back["intensity"], spectrum["intensity"])
    np.testing.assert_allclose((back["time"].to_numpy() - TIME) / np.timedelta64(1, "us"), 0.0, atol=1.0)


@pytest.mark.parametrize("unit", [1.0, u.W])
def test_what_is_masked_is_no_data(unit: float | u.Unit) -> None:
    there = to_radiospectra(assemble(Origin("WIND", "RAD1", "flux_w_m2_hz", "x"), TIME, MHZ, FLUX))
    there.data = np.ma.masked_less(there.data, np.median(FLUX)) if unit == 1.0 else there.data * unit

    back = from_radiospectra(there, "flux_w_m2_hz")["intensity"].to_numpy()

    np.testing.assert_array_equal(np.isnan(back), (np.median(FLUX) > FLUX) & (unit == 1.0))


def callisto(path: Path) -> Path:
    """As e-CALLISTO writes it: frequencies from high to low, times as offsets from the beginning."""
    mhz, second = np.linspace(80.0, 20.0, 30), np.arange(200) * 0.25
    values = np.arange(6000).reshape(30, 200) % 251
    head = fits.Header()
    head["CONTENT"], head["ORIGIN"], head["INSTRUME"], head["TELESCOP"] = "2011/06/07", "Birr", "BIR", "Radio"
    head["DATE-OBS"], head["TIME-OBS"], head["DATE-END"], head["TIME-END"] = (
        "2011/06/07",
        "06:24:00",
        "2011/06/07",
        "06:24:50",
    )
    axes = fits.BinTableHDU.from_columns(
        [
            fits.Column("TIME", "200D", array=second[None]),
            fits.Column("FREQUENCY", "30D", array=mhz[None]),
        ]
    )
    fits.HDUList([fits.PrimaryHDU(values.astype(np.uint8), head), axes]).writeto(path)
    return path


def test_e_callisto_is_read_through_it(tmp_path: Path) -> None:
    path = callisto(tmp_path / "BIR_20110607_062400_10.fit")

    with pytest.raises(InputError, match="read it with radiospectra"):
        open_spectra(path)
    spectrum = validate_spectrum(from_radiospectra(spectrogram.Spectrogram(str(path)), "relative_flux"), path.name)

    assert dict(spectrum.sizes) == {"time": 200, "frequency": 30}
    np.testing.assert_allclose(spectrum["frequency"], np.linspace(20.0, 80.0, 30))
    assert str(spectrum["time"].to_numpy()[4]) == "2011-06-07T06:24:01.000000000"
    assert float(spectrum["intensity"][7, -1]) == 7.0

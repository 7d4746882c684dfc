"""The functions of ``import bella``: what they return, and that importing them costs nothing."""

import doctest
import re
import subprocess
import sys
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import xarray as xr
from astropy import units as u
from astropy.table import QTable
from astropy.time import Time

import bella
from bella import analysis
from bella.arrivals import arrivals_csv
from bella.bursts import published_arrivals
from bella.exceptions import InputError, NoDataError
from bella.multilateration import localise as posterior_of
from bella.records import Interval, JointTrack, Moment, Parameter, SourceAt
from bella.spectra import event_spectra

DOT = r'<circle cx="([-\d.]+)" cy="([-\d.]+)" r="4.2"[^>]*data-mhz="([^"]+)"'
TABLE = published_arrivals(np.array([0.25, 0.5, 1.0]))


@pytest.fixture(scope="module")
def located() -> bella.Localisation:
    return bella.localise(TABLE, draws=50)


def quantities() -> QTable:
    return QTable(
        {
            "observatory": TABLE["observatory"].to_list(),
            "frequency": TABLE["frequency_mhz"].to_numpy() * 1000 * u.kHz,
            "time": Time(TABLE["arrival_utc"].to_numpy(), scale="utc").tt,
            "sigma": TABLE["sigma_s"].to_numpy() / 60 * u.min,
        }
    )


def test_all_forms_of_a_table_give_the_same_posterior(tmp_path: Path, located: bella.Localisation) -> None:
    (tmp_path / "arrivals.csv").write_text(arrivals_csv(TABLE))
    bare = TABLE[["observatory", "frequency_mhz", "arrival_utc", "sigma_s"]]
    expected = posterior_of(TABLE, draws=50)["x_rsun"].to_numpy()
    np.testing.assert_array_equal(located.posterior["x_rsun"], expected)
    file = tmp_path / "arrivals.csv"
    in_file = bella.read_arrivals(str(file))
    for table in (file, in_file, in_file.to_table()):  # the CSV has ten digits
        np.testing.assert_allclose(bella.localise(table, draws=50).posterior["x_rsun"], expected, rtol=1e-9)
    of_units = bella.localise(quantities(), draws=50).posterior["x_rsun"]
    np.testing.assert_allclose(of_units, bella.localise(bare.assign(edge="x"), draws=50).posterior["x_rsun"], rtol=1e-6)


def test_a_localisation_is_a_table_with_units(located: bella.Localisation) -> None:
    table = located.to_table()
    assert table["x_rsun"].unit == u.solRad
    assert table["cov_xy_rsun2"].unit == u.solRad**2
    np.testing.assert_array_equal(table["frequency_mhz"].value, [0.25, 0.5, 1.0])
    assert table.meta["frame"] == "HEE"
    emitted = located.posterior["emission_s"].to_numpy()
    after = (table["emission_utc"] - Time(located.posterior.attrs["reference_time"].removesuffix("Z"))).to_value("s")
    np.testing.assert_allclose(after, emitted, atol=6e-4)


def test_sky_coordinates_are_those_of_the_posterior_and_turn_to_other_frames(located: bella.Localisation) -> None:
    sky = located.to_skycoord()
    np.testing.assert_allclose(sky.cartesian.x.to_value(u.R_sun), located.posterior["x_rsun"])
    distance = np.hypot(located.posterior["x_rsun"], located.posterior["y_rsun"])
    np.testing.assert_allclose(sky.heliographic_stonyhurst.radius.to_value(u.R_sun), distance, rtol=1e-9)
    west_of_earth = np.degrees(np.arctan2(located.posterior["y_rsun"], located.posterior["x_rsun"]))
    # ecliptic and solar longitudes differ by the tilt of the solar equator, 7.25 degrees, at most
    np.testing.assert_allclose(sky.heliographic_stonyhurst.lon.deg, west_of_earth, atol=0.5)


def track() -> bella.FittedTrack:
    def known(value: float) -> Parameter:
        return Parameter(q16=value - 1, q50=value, q84=value + 1)

    profile = (
        SourceAt(frequency_mhz=1.0, range_rsun=known(20.0), longitude_deg=known(90.0)),
        SourceAt(frequency_mhz=0.5, range_rsun=known(40.0), longitude_deg=known(60.0)),
    )
    record = JointTrack(
        model="a spiral",
        rotation_period_d=25.38,
        epoch_utc="2012-06-07T19:29:00.000Z",
        phi0_deg=known(95.0),
        v_sw_km_s=known(400.0),
        beam_speed_c=Parameter(),
        release_utc=Moment(q50="2012-06-07T19:20:00.000Z", sd=30.0),
        profile=profile,
    )
    return bella.FittedTrack(record, located_nowhere())


def located_nowhere() -> xr.Dataset:
    return xr.Dataset()


def test_a_track_is_one_row_and_a_line_in_the_sky() -> None:
    row = track().to_table()[0]
    assert (row["phi0_deg"], row["phi0_low_deg"]) == (95 * u.deg, 94 * u.deg)
    assert row["v_sw_high_km_s"] == 401 * u.km / u.s
    assert np.isnan(row["beam_speed_c"])
    assert row["release_utc"].isot == "2012-06-07T19:20:00.000000"
    sky = track().to_skycoord()
    np.testing.assert_allclose(sky.cartesian.x.to_value(u.R_sun), [0.0, 20.0], atol=1e-9)
    np.testing.assert_allclose(sky.cartesian.y.to_value(u.R_sun), [20.0, 40 * np.sin(np.pi / 3)])
    with pytest.raises(NoDataError, match="no position"):
        bella.FittedTrack(track().record.model_copy(update={"profile": ()}), located_nowhere()).to_skycoord()


def test_a_fit_has_its_draws() -> None:
    fitted = bella.fit_track(published_arrivals(np.geomspace(0.25, 1.5, 8)), draws=200)
    longitude = fitted.posterior["joint_draws"].sel(joint_parameter="phi0_deg")
    assert np.median(longitude) == pytest.approx(fitted.record.phi0_deg.q50, abs=2.0)
    assert "deg" in repr(fitted)


def test_plots_are_figures_of_the_pages_that_a_notebook_shows_and_files_keep(
    tmp_path: Path, located: bella.Localisation
) -> None:
    shown = located.plot()
    assert shown.svg.count("<circle") > len(located.posterior["frequency"])
    assert re.findall(r'data-mhz="([^"]+)"', shown.svg) == ["0.25", "0.5", "1"]
    assert all(name in shown.svg for name in ("Earth, WIND", "STEREO-A", "STEREO-B"))
    assert ElementTree.fromstring(shown._repr_html_()).find(".//{*}style") is not None, "it needs no page"
    shown.save(tmp_path / "map.svg")
    assert (tmp_path / "map.svg").read_text() in shown._repr_html_()
    with pytest.raises(InputError, match=r"\.svg, \.png and \.pdf"):
        shown.save(tmp_path / "map.txt")


def test_arrival_times_are_drawn_where_they_are_with_all_their_errors() -> None:
    table = TABLE.assign(shape_sd_s=20.0, offset_sd_s=30.0, delay_sd_s=10.0)
    drawn = bella.Arrivals(table).plot().svg
    ElementTree.fromstring(drawn)
    (wind,) = re.findall(r'class="series s0"><line (.*?)/><line', drawn)
    x1, y1, x2, y2 = (float(one) for one in re.findall(r'"([-\d.]+)"', wind))
    rows = TABLE[TABLE["observatory"] == "WIND"].sort_values("frequency_mhz")
    seconds = TABLE["arrival_utc"].to_numpy().astype("datetime64[ns]").astype(np.int64) / 1e9
    sigma = np.sqrt(TABLE["sigma_s"].to_numpy() ** 2 + 20.0**2 + 30.0**2 + 10.0**2)
    first, last = (seconds - sigma).min(), (seconds + sigma).max()
    assert y1 == y2 > 200, "the lowest frequency is at the bottom"
    width = 2 * np.sqrt(rows["sigma_s"].iloc[0] ** 2 + 1400.0) / (1.1 * (last - first)) * (620 - 52 - 14)
    assert x2 - x1 == pytest.approx(width, abs=0.2)
    assert "UTC, 2012-06-07" in drawn


def test_a_track_is_drawn_through_the_sources_of_its_profile() -> None:
    drawn = track().plot().svg
    places = {float(mhz): (float(x), float(y)) for x, y, mhz in re.findall(DOT, drawn)}
    ((cx, cy),) = re.findall(r'data-centre="([-\d.]+),([-\d.]+)"', drawn)
    (scale,) = re.findall(r'data-per-rsun="([\d.]+)"', drawn)
    for mhz, (x, y) in {1.0: (0.0, 20.0), 0.5: (20.0, 40 * np.sin(np.pi / 3))}.items():
        seen = ((places[mhz][0] - 310) / float(scale) + float(cx), (280 - places[mhz][1]) / float(scale) + float(cy))
        assert seen == pytest.approx((x, y), abs=0.2)


def test_a_track_without_positions_is_drawn_as_sectors() -> None:
    record = track().record.model_copy(
        update={"profile": (), "phi0_68": (Interval(low=20.0, high=40.0, probability=0.68),)}
    )
    drawn = bella.FittedTrack(record, xr.Dataset()).plot().svg
    assert drawn.count('class="sector"') == 1
    assert "data-mhz" not in drawn


def test_edges_of_spectra_are_timed_with_their_covariance() -> None:
    arrivals = bella.time_edges(event_spectra(), Time("2012-06-07T19:25:00"), edge="half_rise", frequencies=6)
    assert set(arrivals.frame["observatory"]) == {"WIND", "STEREO-A", "STEREO-B"}
    assert arrivals.covariance_s2 is not None
    assert arrivals.covariance_s2.shape == (len(arrivals), len(arrivals))
    assert arrivals.to_table()["sigma_s"].unit == u.s
    with pytest.raises(InputError, match="shared_profile, half_rise"):
        bella.time_edges([], "2012-06-07", edge="first")
    with pytest.raises(InputError, match="around: 'soon' is not a time"):
        bella.time_edges(event_spectra(), "soon")


def test_the_covariance_of_arrival_times_is_used(located: bella.Localisation) -> None:
    wider = bella.Arrivals(TABLE, np.diag(9 * TABLE["sigma_s"].to_numpy() ** 2 + 100.0))
    area = bella.localise(wider, draws=50).posterior["area68_rsun2"]
    assert (area > 2 * located.posterior["area68_rsun2"]).all()


def test_bursts_are_found_in_spectra() -> None:
    found = bella.detect(event_spectra())
    assert len(found) > 0
    assert found.to_table()["f_high_mhz"].unit == u.MHz
    drawn = found.plot().svg
    assert drawn.count("<rect") == len(found)
    assert "data" not in bella.Detections(found.frame[:0]).plot().svg


def test_what_cannot_be_searched_is_not_without_bursts() -> None:
    spectrum = event_spectra()["WIND"].to_dataset()
    found = bella.detect(spectrum.isel(frequency=slice(0, 2)))
    assert len(found) == 0
    assert "search channels" in found.not_searchable[0]
    assert "not searchable" in repr(found)


@pytest.mark.parametrize(
    "around",
    [
        np.datetime64("2012-06-07T19:30"),
        datetime(2012, 6, 7, 21, 30, tzinfo=timezone(timedelta(hours=2))),
        Time("2012-06-07T19:31:06.184", scale="tt"),
        "2012-06-07T21:30+02:00",
        "2012-06-07 19:30:00Z",
    ],
)
def test_a_time_may_be_of_any_type(around: Any) -> None:
    late = analysis._moment(around) - np.datetime64("2012-06-07T19:30")
    assert abs(late) < np.timedelta64(1, "ms")


def test_no_frequency_is_too_few() -> None:
    with pytest.raises(InputError, match="0 frequencies are too few"):
        bella.time_edges(event_spectra(), "2012-06-07T19:30", frequencies=0)


@pytest.mark.parametrize("wrong", [TABLE, 5, [3.0], None])
def test_what_is_no_spectrum_is_named(wrong: Any) -> None:
    with pytest.raises(InputError, match="is no spectrum"):
        bella.detect(wrong)


def test_a_wrong_table_is_one_line_that_names_the_column() -> None:
    with pytest.raises(InputError, match="column sigma: has no unit"):
        bella.localise({"observatory": ["WIND"], "frequency_mhz": [1.0], "time": ["2012-06-07"], "sigma": [1.0]})


def test_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "arrivals.csv").write_text(arrivals_csv(TABLE))
    monkeypatch.chdir(tmp_path)
    result = doctest.testmod(analysis, optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    assert result.attempted > 3
    assert result.failed == 0


def test_importing_bella_imports_nothing_heavy() -> None:
    heavy = "{'numpy', 'pandas', 'xarray', 'astropy', 'scipy', 'matplotlib', 'sunpy'}"
    code = f"import sys, bella; assert not {heavy} & set(sys.modules); assert 'localise' in dir(bella)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="locate"):
        bella.locate  # noqa: B018

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bella.arrivals import OPTIONAL, POSITION, REQUIRED
from bella.bursts import (
    EVENT,
    burst_id,
    fit_time_evolution,
    half_maximum_arrivals,
    half_maximum_edges,
    onset,
    published_arrivals,
    published_rise_times,
    spectrum_edges,
)
from bella.bursts.event import REFERENCE_UTC, published_evolution, published_sigma_s
from bella.exceptions import InputError
from bella.spectra import event_spectra

FOLDER = "event_2012-06-07"
SHORT = {"WIND": "WIND", "STA": "STEREO-A", "STB": "STEREO-B"}
TABLE_MHZ = np.array([2.0, 1.5, 1.0, 0.8, 0.6, 0.4, 0.3, 0.2])
TABLE_DELAY_S = {
    "STEREO-A": np.array([3.0, 22.0, 59.0, 85.0, 127.0, 200.0, 262.0, 348.0]),
    "STEREO-B": np.array([56.0, 74.0, 109.0, 134.0, 177.0, 258.0, 335.0, 478.0]),
}
"""Delays after Wind at half of what the figure shows, which for Wind is an amplitude (independent reduction)."""


def seconds(utc: pd.Series) -> np.ndarray:
    return (utc.to_numpy() - REFERENCE_UTC) / np.timedelta64(1, "s")


def delays_after_wind(arrivals: pd.DataFrame) -> dict[str, np.ndarray]:
    times = {str(name): seconds(rows["arrival_utc"]) for name, rows in arrivals.groupby("observatory")}
    return {name: times[name] - times["WIND"] for name in ("STEREO-A", "STEREO-B")}


@pytest.mark.parametrize("table", [published_arrivals, half_maximum_arrivals])
def test_both_arrival_tables_are_complete(table) -> None:
    arrivals = table()

    assert arrivals.columns.tolist() == [*REQUIRED, *OPTIONAL]
    assert arrivals[[*POSITION]].isna().all(axis=None), "the ephemeris knows where the receivers were"
    assert arrivals.groupby("observatory").size().to_dict() == dict.fromkeys(EVENT.observatories, 200)
    assert arrivals["arrival_utc"].dtype == "datetime64[ns]"
    assert arrivals["frequency_mhz"].agg(["min", "max"]).tolist() == pytest.approx([0.15, 2.0])
    assert not arrivals[[*REQUIRED]].isna().any(axis=None)
    assert arrivals["arrival_utc"].between(EVENT.start_utc, EVENT.stop_utc).all()


def test_lower_frequencies_arrive_later_everywhere() -> None:
    for arrivals in (published_arrivals(), half_maximum_arrivals()):
        for _, rows in arrivals.groupby("observatory"):
            assert rows.sort_values("frequency_mhz")["arrival_utc"].is_monotonic_decreasing


def test_the_name_of_the_event_is_that_of_its_published_onset() -> None:
    first = onset(published_arrivals())

    assert burst_id(first) == EVENT.burst_id == "T3-20120607-1929"
    assert first.astype("datetime64[s]") == EVENT.start_utc


def test_the_published_curves_are_those_read_off_the_figure(reference_files: Path) -> None:
    shared = pd.read_csv(reference_files / FOLDER / "time_evolution_fits.csv").set_index("observatory")
    for short, name in SHORT.items():
        a0, a1, a2 = shared.loc[short].to_numpy()[:3]
        np.testing.assert_array_equal(published_evolution()[name].coefficients, [a2, a1, a0])


def test_the_published_marks_are_those_read_off_the_figure(reference_files: Path) -> None:
    shared = pd.read_csv(reference_files / FOLDER / "rise_times_markers.csv", parse_dates=["rise_time_utc"])
    marks = published_rise_times()

    assert marks["observatory"].tolist() == [SHORT[short] for short in shared["observatory"]]
    np.testing.assert_array_equal(marks["frequency_mhz"], shared["frequency_mhz"])
    np.testing.assert_allclose(seconds(marks["arrival_utc"]), seconds(shared["rise_time_utc"]), atol=0.051)


def test_the_marks_scatter_about_the_curves_by_what_is_given_as_sigma() -> None:
    sigma_s = published_sigma_s()

    assert sigma_s["STEREO-A"] == pytest.approx(23.8, abs=0.1)
    assert sigma_s["STEREO-B"] == pytest.approx(18.7, abs=0.1)
    assert sigma_s["WIND"] == sigma_s["STEREO-A"]
    given = published_arrivals().groupby("observatory")["sigma_s"].unique()
    assert {name: values.tolist() for name, values in given.items()} == {name: [s] for name, s in sigma_s.items()}


def test_published_arrivals_at_chosen_frequencies() -> None:
    arrivals = published_arrivals(np.array([1.0]))

    assert seconds(arrivals["arrival_utc"]) == pytest.approx([570.947, 598.052, 653.674], abs=1e-6)
    assert set(arrivals["edge"]) == {"gauss_hermite"}


@pytest.mark.parametrize("frequency_mhz", [0.1, 2.5, np.nan])
@pytest.mark.parametrize("table", [published_arrivals, half_maximum_arrivals])
def test_frequencies_outside_are_refused(table, frequency_mhz: float) -> None:
    with pytest.raises(InputError, match=r"from 0\.15 to 2 MHz, not at"):
        table(np.array([1.0, frequency_mhz]))


def test_every_channel_of_the_event_has_an_edge() -> None:
    edges = half_maximum_edges()

    assert edges.groupby("observatory").size().to_dict() == {"STEREO-A": 37, "STEREO-B": 37, "WIND": 80}
    assert (edges["flag"] == "").all()
    assert edges["frequency_mhz"].between(0.15, 2.0).all()
    assert edges["sigma_s"].between(4.0, 18.0).all()


def test_half_maximum_is_later_than_the_published_edge_above_the_lowest_frequencies() -> None:
    frequency_mhz = np.array([0.25, 0.5, 1.0, 1.8])

    later_s = seconds(half_maximum_arrivals(frequency_mhz)["arrival_utc"]) - seconds(
        published_arrivals(frequency_mhz)["arrival_utc"]
    )

    assert (later_s > 0.0).all()
    assert later_s.max() < 130.0


def test_half_maximum_sigmas_are_the_scatter_of_the_channels() -> None:
    sigma_s = half_maximum_arrivals().groupby("observatory")["sigma_s"].first()

    assert sigma_s.to_dict() == pytest.approx({"WIND": 24.7, "STEREO-A": 10.3, "STEREO-B": 8.7}, abs=0.1)


def test_delays_of_half_maximum_power() -> None:
    delays = delays_after_wind(half_maximum_arrivals(TABLE_MHZ))

    np.testing.assert_allclose(delays["STEREO-A"], [6, 20, 48, 68, 98, 151, 194, 249], atol=1.0)
    np.testing.assert_allclose(delays["STEREO-B"], [51, 67, 97, 119, 153, 215, 266, 339], atol=1.0)


def test_delays_of_what_the_figure_shows_agree_with_an_independent_reduction() -> None:
    fits = {}
    for name, child in event_spectra().children.items():
        edges = spectrum_edges(child.to_dataset().assign_attrs(power_exponent=1.0), "half_maximum")
        edges = edges[edges["frequency_mhz"].between(0.18, 2.0)]
        arrival_s = seconds(edges["arrival_utc"])
        fits[name] = fit_time_evolution(edges["frequency_mhz"].to_numpy(), arrival_s, np.ones(len(edges)))

    above = TABLE_MHZ >= 0.3
    for name, delay_s in TABLE_DELAY_S.items():
        found_s = fits[name].arrival_s(TABLE_MHZ) - fits["WIND"].arrival_s(TABLE_MHZ)
        np.testing.assert_allclose(found_s[above], delay_s[above], atol=15.0)


def test_single_channels_agree_with_another_digitisation_of_the_figure(reference_files: Path) -> None:
    other = pd.read_csv(reference_files / "arrivals" / "20120607_arrivals_from_digitised.csv")
    for short, name in SHORT.items():
        rows = other[(other["spacecraft"] == short.lower()) & other["freq_mhz"].between(0.16, 1.95)]
        spectrum = event_spectra()[name].to_dataset().assign_attrs(power_exponent=1.0)
        edges = spectrum_edges(spectrum, "half_maximum").set_index("frequency_mhz")
        nearest = edges.index.get_indexer(rows["freq_mhz"], method="nearest", tolerance=0.02)
        midnight_s = (REFERENCE_UTC - np.datetime64("2012-06-07")) / np.timedelta64(1, "s")
        found_s = seconds(edges["arrival_utc"].iloc[nearest[nearest >= 0]]) + midnight_s

        assert (nearest >= 0).sum() >= 25
        difference_s = np.abs(found_s - rows.loc[nearest >= 0, "t_rise_half_interp_s"].to_numpy())
        assert np.quantile(difference_s, 0.9) < 4.0

"""Observability of a day, from spectra to page: who had data, and how well a source would have been located."""

from contextlib import closing
from datetime import date

import numpy as np
import pytest
import xarray as xr
from fastapi.testclient import TestClient

from api.app import create_app
from bella.catalogue import Catalogue, ObservedDay, SearchedDay
from bella.pipeline.observability import fleet_map, observed_day
from bella.records import Origin
from bella.settings import Settings
from bella.spacecraft import position_hee
from bella.units import C_RSUN_S

DAY = date(2021, 11, 20)
NOON = np.datetime64("2021-11-20T12:00", "ns")
CADENCE_S = {"WIND": 60.0, "STEREO-A": 38.0, "SOLO": 17.0, "PSP": 7.0}


def spectrum(name: str, first_hour: int, last_hour: int) -> xr.Dataset:
    step = np.timedelta64(int(CADENCE_S[name] * 1e9), "ns")
    time = np.arange(NOON - np.timedelta64(12 - first_hour, "h"), NOON - np.timedelta64(12 - last_hour, "h"), step)
    intensity = (("time", "frequency"), np.ones((time.size, 2), dtype=np.float32))
    return xr.Dataset({"intensity": intensity}, {"time": time, "frequency": [1.0, 2.0]}, {"observatory": name})


@pytest.fixture(scope="module")
def observed() -> ObservedDay:
    spectra = [spectrum("WIND", 0, 24), spectrum("STEREO-A", 0, 24), spectrum("SOLO", 6, 24), spectrum("PSP", 12, 24)]
    spectra[0]["intensity"][(spectra[0]["time"] > NOON + np.timedelta64(6, "h")).to_numpy()] = np.nan
    return observed_day(DAY, spectra)


def test_fleets_are_those_that_had_data_together(observed: ObservedDay) -> None:
    assert [one.observatories for one in observed.maps] == [
        ("SOLO", "STEREO-A", "WIND"),
        ("PSP", "SOLO", "STEREO-A", "WIND"),
        ("PSP", "SOLO", "STEREO-A"),
    ]
    wind = next(one for one in observed.receivers if one.observatory == "WIND")
    assert wind.fraction[:18] == (1.0,) * 18
    assert max(wind.fraction[19:]) == 0.0


def by_hand_rsun(receivers: np.ndarray, sigma_s: list[float], source: np.ndarray) -> float:
    """Radius of the 68 % region from the curvature of the likelihood alone, the emission time eliminated."""
    away = source - receivers
    weight = np.diag(np.array(sigma_s) ** -2.0)
    direction = (away / np.linalg.norm(away, axis=1, keepdims=True))[:, :2] / C_RSUN_S
    design = np.column_stack([direction, np.ones(len(receivers))])
    covariance = np.linalg.inv(design.T @ weight @ design)[:2, :2]
    # chi-square with two degrees of freedom is below 2.279 with probability 0.68
    return float(np.sqrt(2.279 * np.sqrt(np.linalg.det(covariance))))


def test_radius_is_that_of_the_linear_theory_where_receivers_are_all_round() -> None:
    fleet, noon = ("STEREO-A", "STEREO-B", "WIND"), np.datetime64("2012-06-07T12:00", "ns")
    sigma_s = {"STEREO-A": 38.0, "STEREO-B": 38.0, "WIND": 60.0}
    found = fleet_map(date(2012, 6, 7), fleet, sigma_s)
    assert found is not None
    receivers = np.array([position_hee(name, [noon], noon)[0] for name in fleet])
    for row, distance in enumerate((20.0, 50.0, 100.0)):
        for column, longitude in enumerate(range(-180, 180, 10)):
            angle = np.radians(longitude)
            source = distance * np.array([np.cos(angle), np.sin(angle), 0.0])
            expected = by_hand_rsun(receivers, list(sigma_s.values()), source)
            assert found.radius68_rsun[row][column] == pytest.approx(expected, rel=0.06)


def test_api_and_page_serve_what_was_stored(observed: ObservedDay, empty: Settings) -> None:
    with closing(Catalogue.open(empty.catalogue_url)) as catalogue:
        catalogue.operation.record_observed(observed, "a" * 64)
        assert catalogue.operation.observed(DAY) == observed
        catalogue.record_day(SearchedDay(DAY, "a" * 64, "0", ("WIND",)), ())
    with TestClient(create_app(empty)) as client:
        reply = client.get("/api/v1/observability", params={"time": "2021-11-20T14:30:00Z"})
        early = client.get("/api/v1/observability?time=2021-11-20T02:00").json()
        shifted = client.get("/api/v1/observability", params={"time": "2021-11-20T02:30:00-12:00"}).json()
        absent = client.get("/api/v1/observability?time=2021-11-21T02:00")
        page = client.get(f"/days/{DAY}", headers={"Accept": "text/html"})
        whole = client.get(f"/api/v1/days/{DAY}/observability").json()
    assert reply.status_code == 200
    assert reply.json()["observatories"] == ["PSP", "SOLO", "STEREO-A", "WIND"]
    assert len(reply.json()["map"]["radius68_rsun"]) == 3
    assert len(reply.json()["map"]["radius68_rsun"][0]) == len(reply.json()["longitudes_deg"]) == 36
    assert (early["observatories"], early["localisable"], early["map"]) == (["STEREO-A", "WIND"], False, None)
    assert shifted["observatories"] == ["PSP", "SOLO", "STEREO-A", "WIND"]
    assert absent.status_code == 404
    assert "bella coverage" in absent.json()["detail"]
    assert page.status_code == 200
    assert 'id="observability"' in page.text
    assert len(whole["receivers"]) == 4


def test_observability_of_simulated_data_is_given_to_who_asks_for_it(observed: ObservedDay, empty: Settings) -> None:
    with closing(Catalogue.open(empty.catalogue_url)) as catalogue:
        catalogue.operation.record_observed(observed, "a" * 64, Origin.SIMULATED)
        catalogue.record_day(SearchedDay(DAY, "a" * 64, "0", ("WIND",), origin=Origin.SIMULATED), ())
    with TestClient(create_app(empty)) as client:
        for address in (f"/api/v1/observability?time={DAY}T14:30Z&", f"/api/v1/days/{DAY}/observability?"):
            assert "origin=simulated" in client.get(address.removesuffix("&")).json()["detail"]
            assert client.get(f"{address}origin=simulated").status_code == 200
            assert client.get(f"{address}origin=all").status_code == 200
        page = client.get(f"/days/{DAY}?origin=simulated", headers={"Accept": "text/html"}).text
    assert f"/api/v1/days/{DAY}/observability?origin=simulated" in page
    assert f"/api/v1/observability?time={DAY}T12:00Z&amp;origin=simulated" in page


def test_bad_times_are_refused(empty: Settings) -> None:
    with TestClient(create_app(empty)) as client:
        for time in ("", "yesterday", "2021-13-01T00:00"):
            assert client.get("/api/v1/observability", params={"time": time}).status_code == 422

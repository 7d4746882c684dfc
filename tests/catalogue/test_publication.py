from dataclasses import asdict, replace
from datetime import UTC, datetime, timedelta, timezone
from math import inf, isnan, nan

import numpy as np
import pandas as pd
import pytest
from sqlalchemy import text

from bella.catalogue import BurstQuery, Catalogue, Publication, Series, SourceFile
from bella.catalogue.engine import reading
from bella.exceptions import InputError, NoDataError, StoreError
from tests.catalogue.examples import SERIES, SPECTRUM, START, burst, fitted, localisation, publication


def counts(catalogue: Catalogue) -> dict[str, int]:
    tables = ("burst", "burst_observatory", "solution", "solution_flag", "localisation", "track_fit", "source_file")
    with reading(catalogue._engine) as connection:
        return {name: connection.execute(text(f"SELECT count(*) FROM {name}")).scalar_one() for name in tables}


def test_everything_comes_back_as_it_was_published(catalogue: Catalogue) -> None:
    given = publication()
    solution = catalogue.publish(given)
    assert solution.solution_id == "T3-20120607-1929.half_maximum.posterior.default.2d.v1"
    own = asdict(given)
    found = asdict(solution)
    assert {name: found[name] for name in found.keys() & own.keys()} == {
        name: own[name] for name in found.keys() & own.keys()
    }
    assert abs(solution.created_utc - datetime.now(UTC)) < timedelta(minutes=1)
    assert catalogue.solution(solution.solution_id) == solution
    assert catalogue.localisations(solution.solution_id) == (localisation(0.25), localisation(0.5))
    assert catalogue.track_fit(solution.solution_id) == given.track_fit
    assert catalogue.sources(solution.solution_id) == (SPECTRUM,)
    assert catalogue.burst("T3-20120607-1929").burst == burst()
    assert catalogue.referenced_paths() == {given.store_path}


def test_companions_are_added_once_and_nothing_else_of_a_solution_changes(catalogue: Catalogue) -> None:
    track = fitted().model_copy(update={"companions_pending": True})
    first = catalogue.publish(publication(track_fit=track))
    before, known = datetime.now(UTC), catalogue.track_fit(first.solution_id)
    assert catalogue.bursts(BurstQuery(updated_since=before)).bursts == ()
    beside = {"semp": {"flags": [], "rms_s": np.float64(nan)}}
    later = known | {"companions": {"semp": {"flags": [], "rms_s": None}}, "companions_pending": False}
    with catalogue.lease("localise", first.burst_id, "mine", 60.0) as held:
        assert catalogue.add_companions(first.solution_id, beside, held) == later
    assert catalogue.track_fit(first.solution_id) == later
    assert catalogue.add_companions(first.solution_id, {"semp": {"flags": ["other"]}}) == later
    assert catalogue.track_fit(first.solution_id) == later
    assert catalogue.solution(first.solution_id) == first
    assert len(catalogue.alerts()) == 1, "the answer is the same"
    assert [one.burst.burst_id for one in catalogue.bursts(BurstQuery(updated_since=before)).bursts] == [first.burst_id]
    with pytest.raises(NoDataError):
        catalogue.add_companions(f"{first.solution_id}9", beside)
    other = catalogue.publish(publication(track_fit=track, inputs_hash="f" * 64))
    assert not catalogue.add_companions(other.solution_id, beside)["companions_pending"], "without a lease"


def test_a_superseded_solution_waits_for_no_companions(catalogue: Catalogue) -> None:
    track = fitted().model_copy(update={"companions_pending": True})
    first = catalogue.publish(publication(track_fit=track))
    other = catalogue.publish(publication(series=replace(SERIES, edge="half_rise"), track_fit=track))
    second = catalogue.publish(publication(inputs_hash="other", track_fit=track))
    assert second.supersedes == first.solution_id
    waits = {one.solution_id: catalogue.track_fit(one.solution_id)["companions_pending"] for one in (first, second)}
    assert waits == {first.solution_id: False, second.solution_id: True}
    assert catalogue.track_fit(other.solution_id)["companions_pending"]
    assert catalogue.track_fit(first.solution_id)["joint"] == catalogue.track_fit(second.solution_id)["joint"]


def test_the_same_inputs_and_code_change_nothing(catalogue: Catalogue) -> None:
    first = catalogue.publish(publication())
    before = counts(catalogue)
    again = catalogue.publish(publication(store_path="T3-20120607-1929/other.zarr.zip", of=burst(f_low_mhz=0.01)))
    assert again == first
    assert counts(catalogue) == before
    assert catalogue.burst("T3-20120607-1929").burst == burst()


def test_a_rival_who_was_faster_is_noticed_under_the_lock(
    catalogue: Catalogue, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = catalogue.publish(publication())
    before = counts(catalogue)
    monkeypatch.setattr("bella.catalogue.publication.find_solution", lambda *_: None)
    late = publication(store_path="T3-20120607-1929/late.zarr.zip", of=burst(f_low_mhz=0.01))
    assert catalogue.publish(late) == first
    assert counts(catalogue) == before
    assert catalogue.burst("T3-20120607-1929").burst == burst()


@pytest.mark.parametrize("change", [{"inputs_hash": "h2"}, {"code_version": "0.2.0"}])
def test_other_inputs_or_code_make_the_next_version(catalogue: Catalogue, change: dict[str, str]) -> None:
    first = catalogue.publish(publication())
    second = catalogue.publish(publication(store_path="T3-20120607-1929/second.zarr.zip", **change))
    assert (second.version, second.supersedes) == (2, first.solution_id)
    assert second.solution_id.endswith(".v2")
    assert catalogue.burst("T3-20120607-1929").solutions == (second,)
    superseded = replace(first, preferred=False)
    assert catalogue.versions("T3-20120607-1929") == (second, superseded)
    assert catalogue.solution(first.solution_id) == superseded


def test_only_the_newest_version_counts_as_the_same(catalogue: Catalogue) -> None:
    for number, inputs_hash in enumerate(("h1", "h2", "h1"), start=1):
        path = f"T3-20120607-1929/{number}.zarr.zip"
        assert catalogue.publish(publication(inputs_hash, store_path=path)).version == number
    found = catalogue.find_solution("T3-20120607-1929", SERIES, "h1", "0.1.0")
    assert found is not None
    assert found.version == 3
    assert catalogue.find_solution("T3-20120607-1929", SERIES, "h2", "0.1.0") is None
    assert catalogue.find_solution("T3-20120607-1929", replace(SERIES, dimensions=3), "h1", "0.1.0") is None
    assert catalogue.find_solution("T3-20120607-1930", SERIES, "h1", "0.1.0") is None


def test_series_count_their_versions_on_their_own_and_the_preferred_comes_first(catalogue: Catalogue) -> None:
    wanted = [
        Series("half_maximum", "posterior", "default", 2),
        Series("half_maximum", "posterior", "default", 3),
        Series("gauss_hermite", "posterior", "default", 2),
        Series("half_maximum", "posterior", "paper", 2),
        Series("gauss_hermite", "posterior", "bella-2024", 2),
        Series("half_maximum", "posterior", "own", 2),
        Series("half_maximum", "nuts", "default", 2),
    ]
    for series in reversed(wanted):
        assert catalogue.publish(publication(series=series)).version == 1
    summary = catalogue.burst("T3-20120607-1929")
    # the first that was published stays the preferred one
    assert [one.series for one in summary.solutions] == [wanted[-1], *wanted[:-1]], (
        "the first published stays preferred"
    )
    catalogue.prefer_by_rule("T3-20120607-1929")
    summary = catalogue.burst("T3-20120607-1929")
    assert [one.series for one in summary.solutions] == wanted
    assert summary.preferred == summary.solutions[0]
    assert len(catalogue.versions("T3-20120607-1929")) == len(wanted)


def test_numbers_that_could_not_be_determined_come_back_as_nan(catalogue: Catalogue) -> None:
    flat = localisation(0.5, v_over_c=nan, v_over_c_sd=nan, log_evidence=-inf)
    solid = localisation(1.0, cov_xz_rsun2=0.1, cov_yz_rsun2=0.2, cov_zz_rsun2=0.3)
    solution = catalogue.publish(publication(localisations=(flat, solid)))
    found_flat, found_solid = catalogue.localisations(solution.solution_id)
    assert isnan(found_flat.v_over_c)
    assert isnan(found_flat.v_over_c_sd)
    assert replace(found_flat, v_over_c=0.0, v_over_c_sd=0.0) == replace(flat, v_over_c=0.0, v_over_c_sd=0.0)
    assert found_flat.log_evidence == -inf
    assert found_solid == solid


def test_numbers_and_times_of_numpy_and_pandas_are_taken(catalogue: Catalogue) -> None:
    numpy_row = localisation(
        np.float32(0.5), modes=np.int16(2), x_rsun=np.float32(1.5), emission_utc=pd.Timestamp("2012-06-07 19:30:01.5")
    )
    fit = {"phi0_deg": np.float64(30.0), "edges": np.array([1.0, nan]), "points": np.int64(3), "tuple": (1, inf)}
    solution = catalogue.publish(
        publication(of=burst(f_low_mhz=np.float32(0.25)), localisations=(numpy_row,), track_fit=fit)
    )
    (found,) = catalogue.localisations(solution.solution_id)
    assert (found.frequency_mhz, found.modes, found.x_rsun) == (0.5, 2, 1.5)
    assert found.emission_utc == datetime(2012, 6, 7, 19, 30, 1, 500000, tzinfo=UTC)
    assert catalogue.track_fit(solution.solution_id) == {
        "phi0_deg": 30.0,
        "edges": [1.0, None],
        "points": 3,
        "tuple": [1, None],
    }


def test_times_in_another_zone_are_the_same_instants(catalogue: Catalogue) -> None:
    summer = START.astimezone(timezone(timedelta(hours=2)))
    catalogue.publish(publication(of=burst(start=summer)))
    catalogue.publish(publication(of=burst("T3-20120607-1930", START.replace(tzinfo=None))))
    starts = [one.burst.start_utc for one in catalogue.bursts(BurstQuery()).bursts]
    assert starts == [START, START]
    assert {start.tzinfo for start in starts} == {UTC}


def test_a_new_version_updates_the_burst_but_keeps_its_spectra(catalogue: Catalogue) -> None:
    catalogue.publish(publication("h1", of=burst(spectra_path="T3-20120607-1929/spectra.zarr.zip")))
    catalogue.publish(publication("h2", of=burst(observatories=("PSP", "WIND", "SOLO"), f_low_mhz=0.03)))
    found = catalogue.burst("T3-20120607-1929").burst
    assert found.observatories == ("PSP", "WIND", "SOLO")
    assert found.f_low_mhz == 0.03
    assert found.spectra_path == "T3-20120607-1929/spectra.zarr.zip"
    assert "T3-20120607-1929/spectra.zarr.zip" in catalogue.referenced_paths()


def test_inputs_are_shared_by_solutions_and_their_state_follows(catalogue: Catalogue) -> None:
    other = SourceFile("STA_L3", START.date(), "v02", "ef" * 32, "used", "file:///archive/sta.cdf")
    first = catalogue.publish(publication("h1", sources=(SPECTRUM, other, SPECTRUM)))
    moved = replace(SPECTRUM, uri="https://archive/wi_h1_wav.cdf", state="revised")
    second = catalogue.publish(publication("h2", sources=(other, moved)))
    assert catalogue.sources(first.solution_id) == (moved, other)
    assert catalogue.sources(second.solution_id) == (other, moved)
    assert counts(catalogue)["source_file"] == 2


def refused() -> list[tuple[Publication, str]]:
    return [
        (publication(of=burst("T3/../1929")), "cannot be part of a solution id"),
        (publication(series=replace(SERIES, preset="a.b")), "cannot be part of a solution id"),
        (publication(localisations=(localisation(0.5), localisation(0.5))), "localised twice at 0.5 MHz"),
        (publication(track_fit={"x": {1, 2}}), "cannot hold a set"),
    ]


@pytest.mark.parametrize("case", range(len(refused())))
def test_what_cannot_be_published_leaves_no_trace(catalogue: Catalogue, case: int) -> None:
    wrong, message = refused()[case]
    with pytest.raises(InputError, match=message):
        catalogue.publish(wrong)
    assert set(counts(catalogue).values()) == {0}


def test_two_solutions_never_share_a_group(catalogue: Catalogue) -> None:
    first = catalogue.publish(publication("h1"))
    before = counts(catalogue)
    with pytest.raises(StoreError, match="refused"):
        catalogue.publish(publication("h2", store_path=first.store_path, of=burst(f_low_mhz=0.01)))
    assert counts(catalogue) == before
    assert catalogue.burst("T3-20120607-1929").burst == burst()


def test_what_is_not_there_is_no_data(catalogue: Catalogue) -> None:
    catalogue.publish(publication())
    for asked in (catalogue.burst, catalogue.versions):
        with pytest.raises(NoDataError, match="there is no burst T3-20990101-0000"):
            asked("T3-20990101-0000")
    for wanted in (catalogue.solution, catalogue.localisations, catalogue.track_fit, catalogue.sources):
        with pytest.raises(NoDataError, match="there is no solution nothing"):
            wanted("nothing")


def test_text_the_database_cannot_hold_is_bad_input(postgres_url: str) -> None:
    with Catalogue.open(postgres_url, create=True) as catalogue, pytest.raises(InputError, match="NUL"):
        catalogue.burst("T3-\0")

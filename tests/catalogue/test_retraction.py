"""What is retracted stays, marked, and is no answer any more: on SQLite and PostgreSQL alike."""

from dataclasses import replace

import pytest

from bella.catalogue import BurstQuery, Catalogue, Series, SolutionQuery
from bella.exceptions import InputError, NoDataError
from tests.catalogue.examples import burst, fitted, publication

OTHER = Series("half_rise", "posterior", "default", 2)
BURST = "T3-20120607-1929"


def test_a_retracted_burst_keeps_its_solutions_and_has_no_answer(catalogue: Catalogue) -> None:
    solution = catalogue.publish(publication(track_fit=fitted()))
    assert catalogue.retract(BURST, "timed on interference") == BURST
    kept = catalogue.burst(BURST)
    assert kept.burst.retracted is not None
    assert kept.burst.retracted.reason == "timed on interference"
    assert kept.burst.retracted.retracted_utc > solution.created_utc
    assert kept.preferred is None
    (still,) = kept.solutions
    assert still.retracted == kept.burst.retracted
    assert replace(still, retracted=None, preferred=True) == solution
    assert catalogue.referenced_paths() == {solution.store_path}
    assert len(catalogue.localisations(solution.solution_id)) == 2


def test_lists_hide_what_is_retracted_unless_asked(catalogue: Catalogue) -> None:
    catalogue.publish(publication())
    catalogue.publish(publication(of=burst("T3-20120607-2100")))
    catalogue.retract(BURST, "no burst")
    assert [one.burst.burst_id for one in catalogue.bursts().bursts] == ["T3-20120607-2100"]
    assert catalogue.bursts().total == 1
    assert catalogue.bursts(BurstQuery(with_retracted=True)).total == 2


def test_a_list_of_solutions_hides_those_of_a_retracted_burst_unless_asked(catalogue: Catalogue) -> None:
    catalogue.publish(publication())
    catalogue.publish(publication(of=burst("T3-20120607-2100")))
    catalogue.retract(BURST, "no burst")
    shown, kept = (catalogue.solutions(SolutionQuery(with_retracted=one)).solutions for one in (False, True))
    assert [one.burst_id for one in shown] == ["T3-20120607-2100"]
    assert [one.burst_id for one in kept] == ["T3-20120607-2100", BURST]


def test_a_burst_without_a_solution_that_stands_has_none_to_prefer(catalogue: Catalogue) -> None:
    catalogue.retract(catalogue.publish(publication()).solution_id, "timed on interference")
    with pytest.raises(NoDataError, match="has no solution: run it first"):
        catalogue.prefer_by_rule(BURST)


def test_what_is_published_later_does_not_undo_a_retraction(catalogue: Catalogue) -> None:
    catalogue.publish(publication("h1"))
    catalogue.retract(BURST, "no burst")
    later = catalogue.publish(publication("h2"))
    assert (later.version, later.preferred) == (2, False)
    assert later.retracted is not None
    assert catalogue.burst(BURST).preferred is None
    assert [one.alert_type for one in catalogue.alerts()] == ["PRELIMINARY", "RETRACTION"]


def test_a_retracted_solution_gives_way_to_the_next_series_of_the_rule(catalogue: Catalogue) -> None:
    other = catalogue.publish(publication("h1", series=OTHER, track_fit=fitted()))
    best = catalogue.publish(publication("h1", track_fit=fitted()))
    assert catalogue.prefer(BURST, best.solution_id).preferred
    assert catalogue.retract(best.solution_id, "edge of another burst") == BURST
    kept = catalogue.burst(BURST)
    assert kept.burst.retracted is None
    assert kept.preferred is not None
    assert kept.preferred.solution_id == other.solution_id
    assert kept.preference is not None
    assert kept.preference.chosen_by == "rule"
    assert [one.solution_id for one in kept.solutions] == [other.solution_id, best.solution_id]
    with pytest.raises(NoDataError, match="no such series"):
        catalogue.prefer(BURST, best.solution_id)


def test_a_burst_without_a_solution_that_stands_has_no_answer_until_a_new_one_comes(catalogue: Catalogue) -> None:
    first = catalogue.publish(publication("h1"))
    catalogue.retract(first.solution_id, "wrong file")
    assert catalogue.burst(BURST).preferred is None
    assert catalogue.publish(publication("h1")).retracted is not None
    second = catalogue.publish(publication("h2"))
    assert (second.version, second.supersedes, second.preferred) == (2, first.solution_id, True)
    assert [one.alert_type for one in catalogue.alerts()] == ["PRELIMINARY", "RETRACTION", "UPDATE"]


def test_an_older_version_may_be_retracted_without_any_change_of_the_answer(catalogue: Catalogue) -> None:
    first = catalogue.publish(publication("h1"))
    second = catalogue.publish(publication("h2"))
    catalogue.retract(first.solution_id, "wrong file")
    assert catalogue.solution(second.solution_id) == second
    assert [one.alert_type for one in catalogue.alerts()] == ["PRELIMINARY", "UPDATE"]


@pytest.mark.parametrize("reason", ["", "  ", "two\nlines", "bell\a", "x" * 501])
def test_a_reason_is_one_line_of_words(catalogue: Catalogue, reason: str) -> None:
    catalogue.publish(publication())
    with pytest.raises(InputError, match="--reason must be one line"):
        catalogue.retract(BURST, reason)
    assert catalogue.burst(BURST).burst.retracted is None


def test_nothing_is_retracted_twice_and_nothing_that_is_not_there(catalogue: Catalogue) -> None:
    solution = catalogue.publish(publication())
    catalogue.retract(solution.solution_id, "wrong file")
    with pytest.raises(InputError, match=r"was retracted on .*: wrong file"):
        catalogue.retract(solution.solution_id, "again")
    catalogue.retract(BURST, "no burst")
    with pytest.raises(InputError, match=r"was retracted on .*: no burst"):
        catalogue.retract(BURST, "again")
    with pytest.raises(NoDataError, match="there is no burst or solution T3-1"):
        catalogue.retract("T3-1", "none")


def test_every_version_keeps_the_spectra_it_was_made_from(catalogue: Catalogue) -> None:
    for number in (1, 2):
        one = burst(spectra_path=f"T3/spectra-{number}.zarr.zip")
        catalogue.publish(publication(f"h{number}", of=one))
    new, old = catalogue.versions(BURST)
    assert (old.spectra_path, new.spectra_path) == ("T3/spectra-1.zarr.zip", "T3/spectra-2.zarr.zip")
    assert {"T3/spectra-1.zarr.zip", "T3/spectra-2.zarr.zip"} < catalogue.referenced_paths()


def test_only_superseded_versions_are_pruned(catalogue: Catalogue) -> None:
    first, second = (catalogue.publish(publication(name)) for name in ("h1", "h2"))
    assert catalogue.prunable(second.created_utc) == ()
    later = second.created_utc.replace(year=second.created_utc.year + 1)
    assert [one.solution_id for one in catalogue.prunable(later)] == [first.solution_id]
    catalogue.note_pruned(first.solution_id, "T3/without-draws.zarr.zip", "12" * 32)
    pruned = catalogue.solution(first.solution_id)
    assert (pruned.store_path, pruned.store_sha256) == ("T3/without-draws.zarr.zip", "12" * 32)
    assert pruned.pruned_utc is not None
    assert catalogue.prunable(later) == ()
    assert first.store_path not in catalogue.referenced_paths()

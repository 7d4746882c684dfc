import re
from datetime import date
from typing import Any

import pytest

from bella.catalogue import Burst, Catalogue, submission_name
from bella.exceptions import InputError, NoDataError
from bella.records import Origin
from tests.catalogue.examples import burst, publication

ONE, TWO = "aa" * 32, "bb" * 32
DAY = date(2012, 6, 7)
ANN, BOB = "ann", "bob"


def submitted_burst(submission_id: str, **changes: Any) -> Burst:
    return burst(submission_id, origin=Origin.SUBMISSION, **changes)


def test_tables_wait_in_the_order_they_came(catalogue: Catalogue) -> None:
    first = catalogue.submit(ANN, TWO, submission_name(DAY))
    second = catalogue.submit(ANN, ONE, submission_name(DAY))
    assert catalogue.pending_submissions() == (first, second)
    assert (first.state, first.sha256, first.token_id, first.burst_id, first.message) == (
        "received",
        TWO,
        ANN,
        None,
        "",
    )
    assert catalogue.submission(second.submission_id) == second


def test_a_submission_has_an_id_that_no_burst_of_the_archive_has(catalogue: Catalogue) -> None:
    names = {catalogue.submit(ANN, f"{number:064x}", submission_name(DAY)).submission_id for number in range(20)}
    assert len(names) == 20
    assert all(re.fullmatch(r"S-20120607-[a-z2-9]{10}", name) for name in names)


def test_the_same_table_of_one_token_is_one_submission_and_of_two_tokens_two(catalogue: Catalogue) -> None:
    first = catalogue.submit(ANN, ONE, submission_name(DAY))
    assert catalogue.submit(ANN, ONE, submission_name(DAY)) == first
    other = catalogue.submit(BOB, ONE, submission_name(DAY))
    assert other.submission_id != first.submission_id
    assert catalogue.pending_submissions() == (first, other)


def test_a_table_that_was_localised_is_done_and_stays_so(catalogue: Catalogue) -> None:
    own = catalogue.submit(ANN, ONE, submission_name(DAY)).submission_id
    catalogue.publish(publication(of=submitted_burst(own)))
    done = catalogue.mark_submission(own, "done", burst_id=own)
    assert (done.state, done.burst_id) == ("done", own)
    assert done.changed_utc > done.received_utc
    assert catalogue.pending_submissions() == ()
    assert catalogue.submit(ANN, ONE, submission_name(DAY)) == done


def test_a_table_that_failed_may_be_submitted_again(catalogue: Catalogue) -> None:
    own = catalogue.submit(ANN, ONE, submission_name(DAY)).submission_id
    failed = catalogue.mark_submission(own, "failed", "row 3: sigma_s is 0: give a positive number")
    assert (failed.state, failed.message) == ("failed", "row 3: sigma_s is 0: give a positive number")
    again = catalogue.submit(ANN, ONE, submission_name(DAY))
    assert (again.submission_id, again.state, again.message) == (own, "received", "")


def test_what_was_never_submitted_is_no_data(catalogue: Catalogue) -> None:
    for act in (
        lambda: catalogue.mark_submission("S-20120607-none", "done"),
        lambda: catalogue.submission("S-20120607-none"),
        lambda: catalogue.withdraw("S-20120607-none"),
    ):
        with pytest.raises(NoDataError, match="there is no submission S-20120607-none"):
            act()


def test_a_state_that_is_none_is_bad_input(catalogue: Catalogue) -> None:
    own = catalogue.submit(ANN, ONE, submission_name(DAY)).submission_id
    for state in ("lost", "withdrawn"):
        with pytest.raises(InputError, match="give received, done or failed"):
            catalogue.mark_submission(own, state)
    with pytest.raises(NoDataError, match="there is no burst T3-20990101-0000: publish it first"):
        catalogue.mark_submission(own, "done", burst_id="T3-20990101-0000")
    assert catalogue.submission(own).state == "received"


def test_a_submission_about_the_minute_of_a_burst_leaves_that_burst_as_it_is(catalogue: Catalogue) -> None:
    official = catalogue.publish(publication())
    before = catalogue.burst(official.burst_id)
    own = catalogue.submit(ANN, ONE, submission_name(DAY)).submission_id
    hostile = publication("h9", of=submitted_burst(own, observatories=("AA", "BB", "CC"), f_low_mhz=0.9))
    theirs = catalogue.publish(hostile)
    assert catalogue.burst(official.burst_id) == before
    assert (theirs.version, theirs.supersedes, theirs.origin) == (1, None, Origin.SUBMISSION)
    assert catalogue.burst(own).burst.origin is Origin.SUBMISSION


@pytest.mark.parametrize("origin", [Origin.SUBMISSION, Origin.SIMULATED, Origin.TEST, Origin.USER])
def test_data_of_another_origin_cannot_touch_a_burst_of_the_archive(catalogue: Catalogue, origin: Origin) -> None:
    catalogue.publish(publication())
    before = catalogue.burst("T3-20120607-1929")
    with pytest.raises(InputError, match=f"is of origin archive, and data of origin {origin} cannot change it"):
        catalogue.publish(publication("h2", of=burst(origin=origin, observatories=("AA",))))
    assert catalogue.burst("T3-20120607-1929") == before


def test_archive_and_built_in_event_refine_one_another(catalogue: Catalogue) -> None:
    catalogue.publish(publication("h1", of=burst(origin=Origin.EVENT)))
    assert catalogue.publish(publication("h2", of=burst(origin=Origin.ARCHIVE))).version == 2
    assert catalogue.burst("T3-20120607-1929").burst.origin is Origin.EVENT


def test_a_withdrawn_submission_and_its_burst_stay_as_a_tombstone(catalogue: Catalogue) -> None:
    own = catalogue.submit(ANN, ONE, submission_name(DAY)).submission_id
    catalogue.publish(publication(of=submitted_burst(own)))
    catalogue.mark_submission(own, "done", burst_id=own)
    withdrawn = catalogue.withdraw(own)
    assert (withdrawn.state, withdrawn.message, withdrawn.burst_id) == ("withdrawn", "withdrawn by its submitter", own)
    kept = catalogue.burst(own)
    assert kept.burst.retracted is not None
    assert kept.burst.retracted.reason == "withdrawn by its submitter"
    assert kept.preferred is None
    assert len(kept.solutions) == 1
    assert catalogue.bursts().total == 0
    assert catalogue.withdraw(own) == withdrawn
    assert catalogue.submit(ANN, ONE, submission_name(DAY)) == withdrawn


def test_what_is_withdrawn_while_it_waits_is_not_localised(catalogue: Catalogue) -> None:
    own = catalogue.submit(ANN, ONE, submission_name(DAY)).submission_id
    catalogue.withdraw(own)
    assert catalogue.pending_submissions() == ()
    with pytest.raises(NoDataError, match="was withdrawn: nothing of it is published"):
        catalogue.publish(publication(of=submitted_burst(own)))
    with pytest.raises(NoDataError):
        catalogue.burst(own)
    assert catalogue.mark_submission(own, "failed", "too late").state == "withdrawn"

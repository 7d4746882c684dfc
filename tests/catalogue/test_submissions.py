import pytest

from bella.catalogue import Catalogue
from bella.exceptions import InputError, NoDataError
from tests.catalogue.examples import publication

ONE, TWO = "aa" * 32, "bb" * 32


def test_tables_wait_in_the_order_they_came(catalogue: Catalogue) -> None:
    first = catalogue.submit(TWO, "two.csv")
    second = catalogue.submit(ONE, "one.csv")
    assert catalogue.pending_submissions() == (first, second)
    assert (first.state, first.file_name, first.burst_id, first.message) == ("received", "two.csv", None, "")
    assert catalogue.submission(ONE) == second


def test_the_same_table_is_received_once(catalogue: Catalogue) -> None:
    first = catalogue.submit(ONE, "one.csv")
    assert catalogue.submit(ONE, "again.csv") == first
    assert catalogue.pending_submissions() == (first,)


def test_a_table_that_was_localised_is_done_and_stays_so(catalogue: Catalogue) -> None:
    catalogue.submit(ONE, "one.csv")
    catalogue.publish(publication())
    done = catalogue.mark_submission(ONE, "done", burst_id="T3-20120607-1929")
    assert (done.state, done.burst_id) == ("done", "T3-20120607-1929")
    assert done.changed_utc > done.received_utc
    assert catalogue.pending_submissions() == ()
    assert catalogue.submit(ONE, "one.csv") == done


def test_a_table_that_failed_may_be_handed_in_again(catalogue: Catalogue) -> None:
    catalogue.submit(ONE, "one.csv")
    failed = catalogue.mark_submission(ONE, "failed", "row 3: sigma_s is 0: give a positive number")
    assert (failed.state, failed.message) == ("failed", "row 3: sigma_s is 0: give a positive number")
    again = catalogue.submit(ONE, "again.csv")
    assert (again.state, again.message, again.file_name) == ("received", "", "again.csv")


def test_what_was_never_handed_in_is_no_data(catalogue: Catalogue) -> None:
    catalogue.publish(publication())
    with pytest.raises(NoDataError, match="hand it in first"):
        catalogue.mark_submission(ONE, "done")
    with pytest.raises(NoDataError, match="hand it in first"):
        catalogue.submission("ab" * 32)


def test_a_state_that_is_none_is_bad_input(catalogue: Catalogue) -> None:
    catalogue.submit(ONE, "one.csv")
    with pytest.raises(InputError, match="give received, done or failed"):
        catalogue.mark_submission(ONE, "lost")
    with pytest.raises(NoDataError, match="there is no burst T3-20990101-0000: publish it first"):
        catalogue.mark_submission(ONE, "done", burst_id="T3-20990101-0000")
    assert catalogue.submission(ONE).state == "received"

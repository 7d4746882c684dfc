"""The outbox: written with what it tells, once, in order; and what waits for each receiver."""

from concurrent.futures import ThreadPoolExecutor, wait
from datetime import UTC, datetime, timedelta
from threading import Event

import pytest

from bella.catalogue import Catalogue, Series
from bella.exceptions import InputError, NoDataError
from bella.records import Alert, AlertType, Origin
from tests.catalogue.examples import burst, fitted, localisation, publication

BURST = "T3-20120607-1929"
OTHER = Series("half_rise", "posterior", "default", 2)
EVERYTHING = frozenset(Origin)
NOW = datetime(2100, 1, 1, tzinfo=UTC)


def told(catalogue: Catalogue) -> list[tuple[int, str, str | None]]:
    return [(one.sequence, one.alert_type.value, one.solution_id) for one in catalogue.alerts(origins=EVERYTHING)]


def test_the_story_of_a_burst_is_told_in_order(catalogue: Catalogue) -> None:
    first = catalogue.publish(publication("h1", track_fit=fitted(tier="preliminary")))
    second = catalogue.publish(publication("h2", track_fit=fitted()))
    catalogue.retract(BURST, "timed on interference")
    assert told(catalogue) == [
        (1, "PRELIMINARY", first.solution_id),
        (2, "UPDATE", second.solution_id),
        (3, "RETRACTION", second.solution_id),
    ]
    preliminary, update, retraction = catalogue.alerts()
    assert (preliminary.tier, update.tier) == ("preliminary", "final")
    assert [one.record_number for one in catalogue.alerts(burst_id=BURST)] == [1, 2, 3]
    assert retraction.retracted_reason == "timed on interference"
    assert retraction.sources == ()


def test_an_alert_says_what_the_answer_says(catalogue: Catalogue) -> None:
    solution = catalogue.publish(publication(track_fit=fitted()))
    (alert,) = catalogue.alerts()
    answer = solution.answer
    assert (alert.grade, alert.sentence, alert.phi0_deg) == (answer.grade, answer.sentence, answer.phi0_deg)
    assert (alert.phi0_low_deg, alert.phi0_high_deg) == (answer.phi0_low_deg, answer.phi0_high_deg)
    assert (alert.burst_id, alert.observatories) == (BURST, ("WIND", "STEREO-A", "STEREO-B"))
    assert alert.start_utc == "2012-06-07T19:29:00.000Z"
    assert [one.frequency_mhz for one in alert.sources] == [0.25, 0.5]
    source = alert.sources[0]
    assert (source.x_rsun, source.y_rsun, source.z_rsun) == (20.5, -3.25, 0.0)
    assert (source.cov_xx_rsun2, source.cov_xy_rsun2, source.cov_zz_rsun2) == (4.0, -0.5, None)
    assert source.emission_utc == "2012-06-07T19:29:00.123Z"


def test_nine_usable_frequencies_at_most_from_end_to_end(catalogue: Catalogue) -> None:
    rows = [localisation(0.1 * number) for number in range(1, 31)]
    rows[0] = localisation(0.1, flags="speed_not_constrained;multimodal")
    rows[29] = localisation(3.0, x_rsun=float("nan"))
    catalogue.publish(publication(localisations=tuple(rows)))
    (alert,) = catalogue.alerts()
    assert len(alert.sources) == 9
    assert [round(alert.sources[at].frequency_mhz, 3) for at in (0, -1)] == [0.2, 2.9]


def test_another_series_that_is_not_the_answer_is_not_told(catalogue: Catalogue) -> None:
    catalogue.publish(publication(series=OTHER, track_fit=fitted()))
    catalogue.publish(publication(track_fit=fitted()))
    catalogue.publish(publication("h1", series=OTHER, track_fit=fitted()))
    assert [kind for _, kind, _ in told(catalogue)] == ["PRELIMINARY"]
    catalogue.prefer(BURST, "half_maximum")
    catalogue.prefer(BURST, "half_maximum", "again")
    catalogue.prefer_by_rule(BURST)
    assert [kind for _, kind, _ in told(catalogue)] == ["PRELIMINARY", "UPDATE", "UPDATE"]


def test_an_alert_is_not_there_where_its_publication_is_not(catalogue: Catalogue) -> None:
    bad = publication(localisations=(localisation(0.5, modes=None),))
    with pytest.raises(Exception, match=r"refused|cannot"):
        catalogue.publish(bad)
    assert catalogue.last_alert() == 0
    catalogue.publish(publication())
    assert catalogue.last_alert() == 1


@pytest.mark.parametrize("origin", [Origin.SIMULATED, Origin.TEST])
def test_what_is_not_real_is_told_as_a_test_and_only_to_those_who_ask(catalogue: Catalogue, origin: Origin) -> None:
    catalogue.publish(publication(of=burst("TEST-1", origin=origin)))
    catalogue.retract("TEST-1", "it was a test")
    assert catalogue.alerts() == ()
    assert catalogue.newest_alerts(5) == ()
    found = catalogue.alerts(origins={origin})
    assert [one.alert_type for one in found] == [AlertType.TEST] * 2
    assert [one.retracted_reason for one in found] == [None, "it was a test"]


def test_submissions_are_told_only_to_those_who_ask(catalogue: Catalogue) -> None:
    catalogue.add_webhook("https://example.org/", with_tests=True)
    catalogue.publish(publication(of=burst("S-1", origin=Origin.SUBMISSION)))
    assert catalogue.alerts() == ()
    assert len(catalogue.alerts(origins={Origin.SUBMISSION})) == 1
    assert catalogue.webhooks()[0].waiting == 0


def test_alerts_go_on_after_a_number(catalogue: Catalogue) -> None:
    for number in range(5):
        catalogue.publish(publication(of=burst(f"T3-{number}")))
    assert [one.sequence for one in catalogue.alerts(after=3)] == [4, 5]
    assert [one.sequence for one in catalogue.alerts(limit=2)] == [1, 2]
    assert [one.sequence for one in catalogue.newest_alerts(2)] == [5, 4]
    for limit in (0, 1001):
        with pytest.raises(InputError, match="give 1 to 1000"):
            catalogue.alerts(limit=limit)


def due(catalogue: Catalogue, webhook_id: str, now: datetime = NOW) -> list[Alert]:
    return [one.alert for one in catalogue.due_deliveries(webhook_id, now, 100)]


def test_a_receiver_gets_what_is_told_after_it_was_added(catalogue: Catalogue) -> None:
    catalogue.publish(publication("h1"))
    hook = catalogue.add_webhook("https://example.org/bella")
    tests = catalogue.add_webhook("https://example.org/tests", with_tests=True)
    catalogue.publish(publication("h2"))
    catalogue.publish(publication(of=burst("TEST-1", origin=Origin.TEST)))
    assert [one.sequence for one in due(catalogue, hook.webhook_id)] == [2]
    assert [one.sequence for one in due(catalogue, tests.webhook_id)] == [2, 3]
    assert [one.waiting for one in catalogue.webhooks()] == [1, 2]
    assert hook.secret != tests.secret
    assert len(hook.secret) == 43
    assert hook.secret not in repr(hook)


def test_alerts_of_one_burst_wait_for_one_another_and_other_bursts_do_not(catalogue: Catalogue) -> None:
    own = catalogue.add_webhook("https://example.org/").webhook_id
    for name in ("h1", "h2", "h3"):
        catalogue.publish(publication(name))
    catalogue.publish(publication(of=burst("T3-other")))
    assert [one.sequence for one in due(catalogue, own)] == [1, 4]
    catalogue.note_refused(own, 1, "status 400", NOW + timedelta(minutes=5))
    assert [one.sequence for one in due(catalogue, own)] == [4]
    assert [one.sequence for one in due(catalogue, own, NOW + timedelta(minutes=5))] == [1, 4]
    assert [one.attempts for one in catalogue.due_deliveries(own, NOW + timedelta(hours=1), 1)] == [1]
    assert catalogue.webhooks()[0].message == "status 400"
    catalogue.note_delivered(own, 1)
    assert [one.sequence for one in due(catalogue, own)] == [2, 4]
    assert catalogue.webhooks()[0].message == ""


def test_a_receiver_that_is_away_is_counted_and_forgiven(catalogue: Catalogue) -> None:
    own = catalogue.add_webhook("https://example.org/").webhook_id
    catalogue.publish(publication())
    for _ in range(2):
        catalogue.note_away(own, "no answer", NOW)
    (hook,) = catalogue.webhooks()
    assert (hook.failures, hook.message, hook.next_attempt_utc) == (2, "no answer", NOW)
    catalogue.note_delivered(own, 1)
    assert catalogue.webhooks()[0].failures == 0


def test_a_receiver_that_was_removed_gets_nothing(catalogue: Catalogue) -> None:
    own = catalogue.add_webhook("https://example.org/").webhook_id
    catalogue.publish(publication("h1"))
    removed = catalogue.remove_webhook(own)
    assert removed.removed_utc is not None
    assert removed.secret == ""
    catalogue.publish(publication("h2"))
    assert catalogue.webhooks() == ()
    assert due(catalogue, own) == []
    for name in (own, "none"):
        with pytest.raises(NoDataError, match=f"there is no webhook {name}"):
            catalogue.remove_webhook(name)


def test_publishers_at_once_number_their_alerts_without_gap_or_double(catalogue: Catalogue, catalogue_url: str) -> None:
    """A reader that goes on after the highest number it saw must never have missed a lower one."""
    seen: list[int] = []
    ended = Event()

    def publish(worker: int) -> None:
        with Catalogue.open(catalogue_url) as own:
            for number in range(8):
                own.publish(publication(of=burst(f"T3-{worker}-{number}")))

    def read() -> None:
        with Catalogue.open(catalogue_url) as own:
            while not (ended.is_set() and seen[-1:] == [own.last_alert()]):
                seen.extend(one.sequence for one in own.alerts(after=max(seen, default=0)))

    with ThreadPoolExecutor(4) as pool:
        reader = pool.submit(read)
        publishers = [pool.submit(publish, worker) for worker in range(3)]
        wait(publishers)
        ended.set()
        reader.result(60)
    assert [done.exception() for done in publishers] == [None] * 3
    assert seen == list(range(1, 25))

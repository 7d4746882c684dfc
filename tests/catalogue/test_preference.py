"""One preferred solution per burst: chosen by the rule, kept whatever is published later, changed by a person."""

from dataclasses import replace
from itertools import permutations
from math import nan

import pytest

from bella.answer import Answer
from bella.catalogue import Catalogue, Series
from bella.catalogue.records import rule_order
from bella.exceptions import InputError, NoDataError
from tests.catalogue.examples import burst, fitted, publication

BURST = "T3-20120607-1929"
HALF_RISE = Series("half_rise", "posterior", "default", 2)
MEASURED, EMPTY = fitted(), fitted(nan, flags=("too_few_frequencies",))
EARLY = fitted(50.0, 30.0, "preliminary")

BY_THE_RULE = [
    (Series("shared_profile", "posterior", "default", 2), Answer(has_track=True)),
    (Series("half_rise", "posterior", "default", 2), Answer(has_track=True)),
    (Series("half_rise", "posterior", "default", 3), Answer(has_track=True)),
    (Series("half_maximum", "posterior", "default", 2), Answer(has_track=True)),
    (Series("gauss_hermite", "posterior", "default", 2), Answer(has_track=True)),
    (Series("another", "posterior", "default", 2), Answer(has_track=True)),
    (Series("half_rise", "posterior", "default", 2), Answer(has_track=True, tier="preliminary")),
    (Series("shared_profile", "posterior", "default", 2), Answer()),
    (Series("shared_profile", "posterior", "robust", 2), Answer(has_track=True)),
    (Series("shared_profile", "posterior", "paper", 2), Answer(has_track=True)),
    (Series("shared_profile", "posterior", "own", 2), Answer(has_track=True)),
    (Series("shared_profile", "nuts", "default", 2), Answer(has_track=True)),
]


def preferred(catalogue: Catalogue) -> tuple[str, str, int]:
    found = catalogue.burst(BURST).preferred
    assert found is not None
    assert [one.solution_id for one in catalogue.versions(BURST) if one.preferred] == [found.solution_id]
    return found.series.edge, found.series.preset, found.version


def publish(catalogue: Catalogue, edge: str, inputs: str = "h1", track: object = MEASURED, **changes: str) -> None:
    catalogue.publish(publication(inputs, series=replace(HALF_RISE, edge=edge, **changes), track_fit=track))


def test_rule_has_the_order_that_is_written_down() -> None:
    mixed = BY_THE_RULE[1::2] + BY_THE_RULE[::2]
    assert sorted(mixed, key=lambda one: rule_order(*one)) == BY_THE_RULE


def test_another_preset_method_or_edge_changes_nothing(catalogue: Catalogue) -> None:
    publish(catalogue, "half_maximum", preset="robust")
    for changes in ({}, {"preset": "paper"}, {"method": "nuts"}, {"preset": "robust", "method": "tdoa"}):
        publish(catalogue, "half_rise", **changes)
        publish(catalogue, "shared_profile", **changes)
    publish(catalogue, "shared_profile", preset="robust")
    assert preferred(catalogue) == ("half_maximum", "robust", 1)
    assert catalogue.prefer_by_rule(BURST).series == replace(HALF_RISE, edge="shared_profile")


def test_newer_version_of_the_preferred_series_is_preferred(catalogue: Catalogue) -> None:
    publish(catalogue, "half_rise")
    publish(catalogue, "half_maximum")
    publish(catalogue, "half_rise", "h2")
    assert preferred(catalogue) == ("half_rise", "default", 2)
    publish(catalogue, "half_maximum", "h2")
    assert preferred(catalogue) == ("half_rise", "default", 2)


@pytest.mark.parametrize("order", list(permutations(["half_rise", "half_maximum"])))
def test_series_with_numbers_stands_before_one_without(catalogue: Catalogue, order: tuple[str, str]) -> None:
    for edge in order:
        publish(catalogue, edge, track=EMPTY if edge == "half_rise" else MEASURED)
    assert preferred(catalogue) == ("half_maximum", "default", 1)


def test_burst_without_numbers_is_not_answered_by_another_preset(catalogue: Catalogue) -> None:
    publish(catalogue, "half_rise", track=EMPTY)
    publish(catalogue, "half_rise", preset="paper")
    assert preferred(catalogue) == ("half_rise", "default", 1)


@pytest.mark.parametrize("track", [EMPTY, EARLY])
def test_choice_of_another_preset_stays_even_without_a_final_answer(catalogue: Catalogue, track: object) -> None:
    publish(catalogue, "half_maximum", preset="paper", track=track)
    publish(catalogue, "half_rise")
    assert preferred(catalogue) == ("half_maximum", "paper", 1)
    publish(catalogue, "half_rise", preset="paper")
    assert preferred(catalogue) == ("half_rise", "paper", 1)


def test_final_answer_replaces_the_preliminary_one(catalogue: Catalogue) -> None:
    publish(catalogue, "half_rise", track=EARLY)
    publish(catalogue, "half_maximum", track=EARLY)
    publish(catalogue, "shared_profile", track=EARLY)
    assert catalogue.burst(BURST).preferred.answer.tier == "preliminary"  # type: ignore[union-attr]
    publish(catalogue, "half_maximum", "h2")
    assert preferred(catalogue) == ("half_maximum", "default", 2)
    publish(catalogue, "shared_profile", "h2")
    assert preferred(catalogue) == ("half_maximum", "default", 2), "one final answer is not exchanged for another"


def test_a_person_pins_a_series_until_the_rule_is_asked_for(catalogue: Catalogue) -> None:
    publish(catalogue, "half_rise")
    publish(catalogue, "half_maximum", track=EARLY)
    assert catalogue.burst(BURST).preference.chosen_by == "rule"  # type: ignore[union-attr]
    chosen = catalogue.prefer(BURST, "half_maximum", "its light curves are clean")
    assert (chosen.preferred, chosen.series.edge) == (True, "half_maximum")
    publish(catalogue, "half_rise", "h2")
    publish(catalogue, "half_maximum", "h2", track=EARLY)
    assert preferred(catalogue) == ("half_maximum", "default", 2)
    kept = catalogue.burst(BURST).preference
    assert kept is not None
    assert (kept.chosen_by, kept.reason, kept.series) == ("person", "its light curves are clean", chosen.series)
    assert kept.chosen_utc >= chosen.created_utc
    catalogue.prefer_by_rule(BURST)
    assert preferred(catalogue) == ("half_rise", "default", 2)
    assert catalogue.burst(BURST).preference.chosen_by == "rule"  # type: ignore[union-attr]


@pytest.mark.parametrize(
    "name",
    [
        "half_maximum",
        "half_maximum/posterior/paper",
        "half_maximum.posterior.paper.2d",
        f"{BURST}.half_maximum.posterior.paper.2d",
        f"{BURST}.half_maximum.posterior.paper.2d.v2",
    ],
)
def test_a_series_goes_by_several_names(catalogue: Catalogue, name: str) -> None:
    publish(catalogue, "half_rise")
    publish(catalogue, "half_maximum", preset="paper")
    publish(catalogue, "half_maximum", "h2", preset="paper")
    assert catalogue.prefer(BURST, name).solution_id == f"{BURST}.half_maximum.posterior.paper.2d.v2"


def test_names_that_are_no_single_series_are_refused(catalogue: Catalogue) -> None:
    publish(catalogue, "half_rise", preset="paper")
    publish(catalogue, "half_rise")
    publish(catalogue, "half_rise", "h2")
    with pytest.raises(InputError, match="not one series: name one of half_rise/posterior/"):
        catalogue.prefer(BURST, "half_rise")
    with pytest.raises(InputError, match=r"superseded by .*default\.2d\.v2"):
        catalogue.prefer(BURST, f"{BURST}.half_rise.posterior.default.2d.v1")
    for name in ("half", "gauss_hermite", "", f"{BURST}.half_rise.posterior.default.2d.v3", "half_rise/nuts"):
        with pytest.raises(NoDataError, match="this burst has no such series"):
            catalogue.prefer(BURST, name)
    for call in (lambda: catalogue.prefer("T3-19990101-0000", "half_rise"), lambda: catalogue.prefer_by_rule("T3-1")):
        with pytest.raises(NoDataError, match="there is no burst"):
            call()
    assert preferred(catalogue) == ("half_rise", "paper", 1)


def test_answer_is_stored_with_the_solution(catalogue: Catalogue) -> None:
    publish(catalogue, "half_rise")
    (listed,) = catalogue.bursts().bursts
    assert listed.preferred is not None
    said = listed.preferred.answer
    assert said.sentence == "26° W (22 to 30), 21 R_sun, wind 590 km/s (490 to 690), grade A"
    assert (said.grade, said.tier, said.phi0_low_deg, said.v_sw_high_km_s) == ("A", "final", 21.5, 690.0)
    assert catalogue.track(listed.preferred.solution_id) == MEASURED
    assert catalogue.track_fit(listed.preferred.solution_id)["joint"]["phi0_deg"]["q50"] == 26.0


def test_preferences_of_bursts_are_their_own(catalogue: Catalogue) -> None:
    other = burst("T3-20120608-0000")
    for one in (burst(), other):
        for edge in ("half_rise", "half_maximum"):
            catalogue.publish(publication(of=one, series=replace(HALF_RISE, edge=edge), track_fit=MEASURED))
    catalogue.prefer(BURST, "half_maximum")
    edges = {one.burst.burst_id: one.preferred.series.edge for one in catalogue.bursts().bursts if one.preferred}
    assert edges == {BURST: "half_maximum", other.burst_id: "half_rise"}

"""Grade and sentence of a solution, from the track and the positions alone."""

from dataclasses import dataclass
from math import nan
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bella.answer import Answer, answer_of, interval_68, placed_numbers, read_track, wind_gap, written_68, written_wind
from bella.flags import FLAGS, HARMLESS_FLAGS, SERIOUS_FLAGS, UNUSABLE_POSITION_FLAGS
from bella.records import Interval, JointTrack, Moment, Parameter, SourceAt, Track


@dataclass
class Place:
    """A position on the x axis."""

    x_rsun: float
    flags: str = ""
    y_rsun: float = 0.0
    z_rsun: float = 0.0
    area68_rsun2: float = 7.0


PLACES = (Place(91.0), Place(13.0), Place(40.0))


def parameter(q16: float, q50: float, q84: float, contraction: float | None = 0.4) -> Parameter:
    return Parameter(q16=q16, q50=q50, q84=q84, mean=q50 + 3.0, sd=99.0, contraction=contraction)


def track(longitude: Parameter, wind: Parameter | None = None, **changes: Any) -> Track:
    wind = wind or parameter(450.0, 590.0, 940.0)
    joint = JointTrack(
        model="joint",
        rotation_period_d=25.38,
        epoch_utc="",
        phi0_deg=longitude,
        v_sw_km_s=wind,
        beam_speed_c=Parameter(),
        release_utc=Moment(),
        **({"misfit_p": 0.5} | changes),
    )
    return Track(remark="", rotation_period_d=25.38, joint=joint)


def sentence(longitude: Parameter, wind: Parameter | None = None, **changes: Any) -> str:
    return answer_of(track(longitude, wind, **changes), PLACES).sentence


def grade(half_width_deg: float, places: tuple[Place, ...] = PLACES, **changes: Any) -> str:
    return answer_of(track(parameter(26.0 - half_width_deg, 26.0, 26.0 + half_width_deg), **changes), places).grade


@pytest.mark.parametrize(
    ("quantiles", "words"),
    [
        ((22.0, 26.0, 31.0), "26° W (22 to 31)"),
        ((-31.0, -26.0, -22.0), "26° E (22 to 31)"),
        ((-4.0, 2.0, 5.0), "2° W (4 E to 5 W)"),
        ((-4.0, 0.2, 5.0), "0° (4 E to 5 W)"),
        ((172.0, 178.0, 186.0), "178° W (172 W to 174 E)"),
        ((180.4, 190.0, 199.0), "170° E (161 to 180)"),
        ((25.8, 26.3, 26.9), "26.3° W (25.8 to 26.9)"),
    ],
)
def test_longitude_is_said_west_and_east_of_earth(quantiles: tuple[float, float, float], words: str) -> None:
    assert sentence(parameter(*quantiles)).startswith(f"{words}, 13 to 91 R_sun, wind 590 km/s (450 to 940), grade ")


def test_answer_of_a_good_track_is_whole() -> None:
    assert answer_of(track(parameter(22.0, 26.0, 31.0)), PLACES) == Answer(
        tier="final",
        grade="A",
        sentence="26° W (22 to 31), 13 to 91 R_sun, wind 590 km/s (450 to 940), grade A",
        has_track=True,
        phi0_deg=26.0,
        phi0_low_deg=22.0,
        phi0_high_deg=31.0,
        range_low_rsun=13.0,
        range_high_rsun=91.0,
        area68_rsun2=7.0,
        v_sw_km_s=590.0,
        v_sw_low_km_s=450.0,
        v_sw_high_km_s=940.0,
    )


@pytest.mark.parametrize(
    ("half_width_deg", "changes", "expected"),
    [
        (4.9, {}, "A"),
        (5.1, {}, "B"),
        (9.9, {}, "B"),
        (10.1, {}, "C"),
        (4.0, {"misfit_p": 5e-4}, "B"),
        (4.0, {"misfit_p": 1 - 5e-4}, "B"),
        (4.0, {"misfit_p": 2e-3}, "A"),
        (4.0, {"misfit_p": None}, "B"),
        (4.0, {"flags": ("v_sw_not_constrained",)}, "A"),
        (4.0, {"flags": ("arrivals_down_weighted",)}, "B"),
        (4.0, {"flags": ("a_flag_of_tomorrow",)}, "B"),
        *((4.0, {"flags": (flag,)}, "C") for flag in sorted(SERIOUS_FLAGS)),
        (4.0, {"flags": ("several_tracks",)}, "D"),
        (4.0, {"flags": ("phi0_not_constrained",)}, "D"),
        (4.0, {"tier": "preliminary"}, "D"),
    ],
)
def test_grade_goes_down_with_width_misfit_and_flags(
    half_width_deg: float, changes: dict[str, Any], expected: str
) -> None:
    assert grade(half_width_deg, **changes) == expected


@pytest.mark.parametrize(("flagged", "expected"), [(5, "A"), (6, "C")])
def test_flags_of_positions_count_where_most_have_them(flagged: int, expected: str) -> None:
    places = tuple(Place(20.0 + i, "speed_above_c;speed_not_constrained" if i < flagged else "") for i in range(10))
    assert grade(4.0, places) == expected


def test_flags_that_decide_a_grade_are_known_and_do_not_contradict() -> None:
    assert set(FLAGS) >= (HARMLESS_FLAGS | SERIOUS_FLAGS | UNUSABLE_POSITION_FLAGS)
    assert not HARMLESS_FLAGS & SERIOUS_FLAGS


@pytest.mark.parametrize(
    "changes",
    [
        {"flags": ("v_sw_not_constrained",)},
        {"flags": ("not_a_spiral",)},
        {"wind": parameter(450.0, 590.0, 940.0, contraction=1.0)},
        {"wind": parameter(-450.0, 590.0, 940.0)},
        {"wind": Parameter()},
    ],
)
def test_wind_that_was_not_measured_is_no_number(changes: dict[str, Any]) -> None:
    found = answer_of(track(parameter(22.0, 26.0, 31.0), **changes), PLACES)
    assert "R_sun, wind not measured, grade" in found.sentence
    assert (found.v_sw_km_s, found.v_sw_low_km_s, found.v_sw_high_km_s) == (None, None, None)


def test_preliminary_track_has_intervals_with_probabilities_and_no_wind() -> None:
    parts = (Interval(low=-20.0, high=40.0, probability=0.46), Interval(low=150.0, high=200.0, probability=0.22))
    profile = tuple(
        SourceAt(frequency_mhz=f, range_rsun=parameter(d - 5, d, d + 9), longitude_deg=Parameter())
        for f, d in ((1.0, 25.0), (0.3, 80.0))
    )
    found = answer_of(
        track(parameter(0.0, 26.0, 160.0), tier="preliminary", phi0_68=parts, profile=profile), (Place(500.0),)
    )
    assert found.sentence == ("preliminary: 20° E to 40° W (46 %) or 150° W to 160° E (22 %), 25 to 80 R_sun, grade D")
    assert (found.tier, found.has_track, found.phi0_deg, found.v_sw_km_s) == ("preliminary", True, None, None)
    unknown = answer_of(track(parameter(0.0, 26.0, 160.0), tier="preliminary", phi0_68=parts[:1]), PLACES)
    assert unknown.sentence == "preliminary: 20° E to 40° W (46 %), distance not known, grade D"


def test_final_track_in_two_parts_has_no_single_longitude() -> None:
    parts = (Interval(low=10.0, high=20.0, probability=0.5), Interval(low=-100.0, high=-90.0, probability=0.18))
    said = sentence(parameter(0.0, 15.0, 18.0), phi0_68=parts)
    assert said == "10° W to 20° W (50 %) or 100° E to 90° E (18 %), 13 to 91 R_sun, grade D"
    assert sentence(parameter(1.0, 2.0, 3.0), flags=("several_tracks",)) == (
        "no single longitude (several tracks explain the times), 13 to 91 R_sun, grade D"
    )


def test_no_track_says_why() -> None:
    few = answer_of(track(Parameter(), flags=("too_few_frequencies",)), PLACES)
    assert few.sentence.startswith("no track (fewer than four frequencies, or than twelve arrival times), ")
    assert not few.has_track
    assert answer_of(None, PLACES).sentence == "no track (none was fitted), positions at 0°, 13 to 91 R_sun, grade D"
    beside = (Place(10.0, "", 5.0), Place(10.0, "", -3.0))
    assert answer_of(None, beside).sentence == (
        "no track (none was fitted), positions at 17° E to 27° W, 10 to 11 R_sun, grade D"
    )
    assert "position" not in answer_of(None, (Place(10.0), Place(-10.0))).sentence
    assert answer_of(None, ()).sentence == "no track (none was fitted), grade D"


@pytest.mark.parametrize("flag", sorted(UNUSABLE_POSITION_FLAGS))
def test_distances_are_those_of_positions_that_mean_something(flag: str) -> None:
    places = (*PLACES, Place(230.0, f"speed_not_constrained;{flag}"), Place(nan))
    found = answer_of(track(parameter(22.0, 26.0, 31.0)), places)
    assert (found.range_low_rsun, found.range_high_rsun) == (13.0, 91.0)
    in_space = answer_of(None, (Place(3.0, "", 4.0, 12.0),))
    assert in_space.sentence == "no track (none was fitted), position at 53° W, 13 R_sun, grade D"


def test_latitudes_and_area_are_those_of_positions_that_mean_something() -> None:
    none = {"latitude_low_deg": None, "latitude_high_deg": None}
    assert placed_numbers(()) == none | {"area68_rsun2": None}
    assert placed_numbers(PLACES) == none | {"area68_rsun2": 7.0}
    places = (
        Place(3.0, "", 4.0, -5.0, 10.0),
        Place(0.0, "speed_above_c", 5.0, 5.0 / 3**0.5, 30.0),
        Place(4.0, "", -3.0, 1.0, 20.0),
        Place(1.0, "multimodal", 0.0, 90.0, 9000.0),
        Place(nan, "", nan, nan, nan),
    )
    found = placed_numbers(places)
    assert found == pytest.approx({"latitude_low_deg": -45.0, "latitude_high_deg": 30.0, "area68_rsun2": 20.0})
    said = answer_of(None, places)
    assert (said.latitude_low_deg, said.area68_rsun2) == (found["latitude_low_deg"], 20.0)
    nothing = answer_of(track(parameter(22.0, 26.0, 31.0), flags=("not_one_source",)), places)
    assert (nothing.latitude_low_deg, nothing.area68_rsun2, nothing.range_low_rsun) == (None, None, None)


OLDER = {
    "frame": "HEE",
    "two_step": {"phi0_deg": {"mean": 1.0}},
    "two_step_other_rotations": {},
    "rotation_period_d": 24.47,
    "joint": {
        "phi0_deg": {"mean": -28.0, "sd": 6.0, "q16": -35.0, "q50": -28.5, "q84": -22.0, "contraction": 0.1},
        "v_sw_km_s": {"mean": 440.0, "sd": 90.0},
        "a_rsun": {"mean": 36.0},
        "release_utc": {"mean": "2012-06-07T19:20:29.779Z", "sd": 8.8, "contraction": None},
        "times": "arrival table",
        "flags": ["poor_fit"],
        "misfit_p": 1e-9,
    },
}


def test_older_json_is_read_as_far_as_it_goes() -> None:
    read = read_track(OLDER)
    assert read is not None
    assert (read.joint.phi0_deg.q50, read.joint.v_sw_km_s.q16, read.joint.flags) == (-28.5, 350.0, ("poor_fit",))
    assert answer_of(read, PLACES).sentence == "28° E (22 to 35), 13 to 91 R_sun, wind 440 km/s (350 to 530), grade C"
    assert read_track({"two_step": {}}) is None
    assert read_track({}) is None
    new = track(parameter(22.0, 26.0, 31.0))
    assert read_track(new.model_dump(mode="json")) == new


def test_numbers_are_medians_and_no_spiral_has_no_speed() -> None:
    assert interval_68({"q16": 1.0, "q50": 2.0, "q84": 4.0, "mean": 9.0, "sd": 9.0}) == (2.0, 1.0, 4.0)
    assert interval_68({"mean": 9.0, "sd": 2.0}) == (9.0, 7.0, 11.0)
    assert interval_68({"mean": None, "sd": None}) is interval_68(None) is None
    assert written_68({"mean": -9.25, "sd": 2.0}) == "-9.2 (-11.2 to -7.2)"
    assert written_68({"mean": 400.0}, 0) == "400"
    speed = {"mean": 9758.0, "sd": 68301.0}
    assert wind_gap({"v_sw_km_s": speed}) == wind_gap({"flags": ["not_a_spiral"]}) == "no spiral"
    assert written_wind({"v_sw_km_s": {"mean": 440.0, "sd": 90.0}}) == "440 (350 to 530) km/s"
    unmeasured = {"v_sw_km_s": {"mean": 440.0, "sd": 90.0}, "flags": ["v_sw_not_constrained"]}
    assert written_wind(unmeasured) == "not measured"
    assert written_wind({"v_sw_km_s": 400.0}) == written_wind({}) == ""


@given(
    middle=st.floats(-400, 400),
    below=st.floats(0, 200),
    above=st.floats(0, 200),
    flags=st.sets(st.sampled_from([*FLAGS])),
    p=st.floats(0, 1),
)
@settings(derandomize=True, max_examples=200)
def test_every_track_has_a_sentence_that_ends_with_its_grade(
    middle: float, below: float, above: float, flags: set[str], p: float
) -> None:
    one = track(parameter(middle - below, middle, middle + above), flags=tuple(flags), misfit_p=p)
    found = answer_of(one, PLACES)
    assert found.sentence.endswith(f", grade {found.grade}")
    assert "-" not in found.sentence.replace("-0", "")
    turned = track(parameter(middle - below - 360, middle - 360, middle + above - 360), flags=tuple(flags), misfit_p=p)
    assert answer_of(turned, PLACES).grade == found.grade


def test_times_of_several_sources_give_no_number() -> None:
    answer = answer_of(track(parameter(25.0, 26.0, 27.0), flags=("not_one_source",)), PLACES)

    assert answer.grade == "D"
    assert answer.sentence == "no longitude to be used (the times are not those of one source), grade D"
    assert answer.phi0_deg is answer.v_sw_km_s is answer.range_low_rsun is None

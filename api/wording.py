"""Sentences that more than one reply or page says."""

from bella.flags import APPARENT_SOURCE, COMPANION_FLAGS, FLAGS
from bella.records import DayAnswer

__all__ = ["APPARENT_SOURCE", "flag_meaning"]


def flag_meaning(flag: str) -> str:
    """What a quality flag means, for a reader of the page."""
    return (FLAGS | COMPANION_FLAGS).get(flag, flag.replace("_", " "))


NOT_COMPARED = "its position is not known, so it was not compared with others"


_ANSWERS = {
    DayAnswer.NO_DATA: "the archives were asked and have no file of this day.",
    DayAnswer.ARCHIVE_SILENT: "an archive could not be asked, so it is not known whether there are files of this day.",
    DayAnswer.NOT_SEARCHABLE: "there are files, but a burst could not be found in them whatever the Sun did.",
    DayAnswer.NO_BURST: "the spectra were searched, and no burst was found in them.",
    DayAnswer.NOT_LOCALISABLE: "bursts were found, but none could be localised.",
    DayAnswer.LOCALISED: "at least one burst was localised.",
}


def answer_words(answer: DayAnswer) -> str:
    """What an answer about a day means, for a reader of the page."""
    return _ANSWERS[answer]


def answer_class(answer: DayAnswer) -> str:
    """Name of an answer in style sheets, such as answer-no-burst."""
    return f"answer-{answer.value.replace(' ', '-')}"


def reason_words(reason: str) -> str:
    """Why a burst was not localised, or a candidate refused, for a reader of the page."""
    return reason.removeprefix("not localisable: ").replace("_", " ").replace(" mhz", " MHz")

"""Sentences that more than one reply or page says."""

from bella.flags import APPARENT_SOURCE, COMPANION_FLAGS, FLAGS

__all__ = ["APPARENT_SOURCE", "EDGE_DECIDES", "flag_meaning"]

EDGE_DECIDES = (
    "The definition of the edge decides the track: each row is the same burst, timed at another point of its rise. "
    "The difference between the rows is a systematic error that the error bars of one row do not hold."
)


def flag_meaning(flag: str) -> str:
    """What a quality flag means, for a reader of the page."""
    return (FLAGS | COMPANION_FLAGS).get(flag, flag.replace("_", " "))


NOT_COMPARED = "its position is not known, so it was not compared with others"


def reason_words(reason: str) -> str:
    """Why a burst was not placed, or a candidate refused, for a reader of the page."""
    return reason.removeprefix("not localisable: ").replace("_", " ").replace(" mhz", " MHz")

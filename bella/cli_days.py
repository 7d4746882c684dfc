"""What ``bella run --from`` prints of the days it has processed."""

from collections.abc import Sequence
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

MOST_REFUSALS = 3


def days_table(days: Sequence[dict[str, Any]]) -> Table:
    """Table of processed days.

    Parameters
    ----------
    days : sequence of dict
        Summaries: day, state, observatories, detections, bursts, localised, refused, message.

    Returns
    -------
    rich.table.Table
    """
    table = Table("day", "state", "heard", "bursts", "localised", "not localised", box=SIMPLE_HEAD, pad_edge=False)
    for day in days:
        table.add_row(
            day["day"],
            day["state"],
            f"{day['detections']} by {len(day['observatories'])}" if day["state"] == "searched" else "",
            f"{day['bursts']}" if day["state"] == "searched" else "",
            "\n".join(day["localised"]),
            day["message"] or _refusals(day["refused"]),
        )
    return table


def _refusals(refused: Sequence[dict[str, str]]) -> str:
    """The most common reasons, each with how often it occurs."""
    reasons = [one["reason"].removeprefix("not localisable: ") for one in refused]
    counted = sorted(((reasons.count(reason), reason) for reason in set(reasons)), reverse=True)
    shown = [f"{number} x {reason}" for number, reason in counted[:MOST_REFUSALS]]
    return "\n".join(shown + [f"and {len(counted) - MOST_REFUSALS} more"] * (len(counted) > MOST_REFUSALS))

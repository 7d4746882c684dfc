"""What simulated bursts say of a real answer: those that are like it, and how often their intervals held the truth.

Nothing is fitted here: the published table is read.
"""

from dataclasses import dataclass

from bella.calibration.found_table import ALL, FLEET_OF, FoundRow, stratum_of
from bella.records import Origin, Tier

METHOD, PRESET = "posterior", "default"
"""How the simulated bursts were localised; answers of other methods and presets were not tried."""

PAGE = "docs/calibration-found.md"
"""The report on all of them."""

LONGITUDE = "phi0"
"""Quantity that the sentence is about: every answer with a track has it."""

FEWEST_BURSTS = 10
"""Of fewer the Wilson interval of a share of 0.68 is wider than half, and they say nothing."""

SPACECRAFT = {2: "two", 3: "three", 4: "four or more"}
NOT_TRIED = "No simulated burst was timed and localised like this one: how often its intervals hold is not known."


@dataclass(frozen=True)
class Answered:
    """How a real burst was timed, localised and graded.

    Attributes
    ----------
    spacecraft : int
        That received it; a preliminary answer is of two of them.
    edge, tier, grade, method, preset : str
        Of the solution.
    origin : Origin
        Of its data; submitted times were taken by somebody else.
    """

    spacecraft: int
    edge: str
    tier: Tier
    grade: str
    method: str = METHOD
    preset: str = PRESET
    origin: Origin = Origin.ARCHIVE


@dataclass(frozen=True)
class Tried:
    """Simulated bursts like a real one.

    Attributes
    ----------
    stratum : str
        Which they are, in words.
    rows : tuple of FoundRow
        Of all that were timed by the same edge, then of all that have the same grade; one for each number.
    sentence : str
        How often the 68 % interval of their longitude held the truth.
    """

    stratum: str
    rows: tuple[FoundRow, ...]
    sentence: str


def tried(real: Answered) -> Tried | None:
    """Find the simulated bursts that are like a real one in the published table; None where there are none."""
    if (real.method, real.preset) != (METHOD, PRESET) or real.origin is Origin.SUBMISSION:
        return None
    timed = 2 if real.tier == "preliminary" else real.spacecraft
    of_edge = _enough(stratum_of(timed, real.edge, real.tier))
    of_grade = _enough(stratum_of(timed, ALL, real.tier, grade=real.grade))
    longitude, graded = (next((one for one in of if one.quantity == LONGITUDE), None) for of in (of_edge, of_grade))
    if longitude is None:
        return None
    number = SPACECRAFT[min(timed, max(FLEET_OF))]
    sentence = (
        f"Of the 68 % intervals of the longitude of {longitude.bursts} simulated bursts with {number} spacecraft, "
        f"timed like this one, {_share(longitude)} held the truth"
    )
    if graded:
        sentence += f"; of the {graded.bursts} with grade {real.grade}, {_share(graded)}"
    stratum = f"{number} spacecraft, tier {real.tier}, edge {real.edge}, all laws together"
    return Tried(stratum, of_edge + of_grade, f"{sentence}.")


def _enough(rows: tuple[FoundRow, ...]) -> tuple[FoundRow, ...]:
    return tuple(one for one in rows if one.bursts >= FEWEST_BURSTS)


def _share(row: FoundRow) -> str:
    share, low, high = (100 * (value or 0.0) for value in (row.cover68, row.cover68_low, row.cover68_high))
    return f"{share:.0f} % ({low:.0f} to {high:.0f})"

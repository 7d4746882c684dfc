"""Names of spacecraft as people write them."""

import difflib
import re

from bella.exceptions import InputError

ALIASES = {
    "WIND": ("wind", "wi", "win", "windwaves"),
    "STEREO-A": ("stereoa", "sta", "stereoahead", "ahead", "stereo a"),
    "STEREO-B": ("stereob", "stb", "stereobehind", "behind"),
    "PSP": ("psp", "parker", "parkersolarprobe", "spp", "solarprobeplus"),
    "SOLO": ("solo", "solarorbiter", "so", "orbiter"),
    "EARTH": ("earth",),
    "ACE": ("ace",),
}
"""Other names by the name that is used here; case, blanks, dashes and underscores do not count."""

CLOSE = 0.75
"""Names that agree by this share of their letters are taken for a typing error (difflib)."""

SHORTEST = 4
"""Shorter names are not taken for one: many three-letter names are those of other spacecraft."""


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


_BY_ALIAS = {_plain(alias): name for name, aliases in ALIASES.items() for alias in (name, *aliases)}


def observatory_name(name: str) -> str:
    """Name of a spacecraft as it is used here.

    Parameters
    ----------
    name : str
        As people write it: "Solar Orbiter", "STA", "stereo_a".

    Returns
    -------
    str
        Such as "SOLO"; a name that is not near to any known one is another spacecraft and stays as it is.

    Raises
    ------
    InputError
        If it is empty, or so near to a known name that it must be a typing error.
    """
    plain = _plain(name)
    if not plain:
        raise InputError(f"{name!r} is no name of a spacecraft: give one such as {', '.join(ALIASES)}")
    if plain in _BY_ALIAS:
        return _BY_ALIAS[plain]
    near = difflib.get_close_matches(plain, _BY_ALIAS, 2, CLOSE) if len(plain) >= SHORTEST else []
    if near:
        meant = " or ".join(sorted({_BY_ALIAS[one] for one in near}))
        raise InputError(f"no spacecraft is named {name!r}: did you mean {meant}?")
    return name.strip()

"""Where Prefect and the libraries under it keep their files: inside the home folder, and nowhere else.

Must be called before Prefect, matplotlib, numba or PyTensor are imported, because they read these variables then.
"""

import os

from bella.exceptions import InputError
from bella.settings import Settings
from bella.spacecraft import extend_with


def prepare(settings: Settings) -> None:
    """Point every library that writes files at the home folder, and turn off what would call home.

    Positions of spacecraft go on with the table that the home folder holds, if it holds one.

    A variable that is set already is left as it is: an operator's choice wins.

    Parameters
    ----------
    settings : Settings

    Raises
    ------
    InputError
        If the home folder cannot be made.
    """
    home, cache = settings.home.resolve(), settings.cache_root.resolve()
    try:
        cache.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"home folder {home}: {error.strerror}; name another with --home or BELLA_HOME") from error
    for name, value in {
        "PREFECT_HOME": home / "prefect",
        "PREFECT_SERVER_ANALYTICS_ENABLED": "false",
        "PREFECT_LOGGING_LEVEL": "CRITICAL",
        "PREFECT_INTERNAL_LOGGING_LEVEL": "CRITICAL",  # events cut short when the server ends are no news
        "PREFECT_LOGGING_TO_API_ENABLED": "false",
        "PREFECT_CLI_PROMPT": "false",
        "DO_NOT_TRACK": "1",
        "MPLCONFIGDIR": cache / "matplotlib",
        "NUMBA_CACHE_DIR": cache / "numba",
        "PYTENSOR_FLAGS": f"base_compiledir={cache / 'pytensor'}",
        "XDG_CACHE_HOME": cache,
        "XDG_CONFIG_HOME": cache,
    }.items():
        os.environ.setdefault(name, str(value))
    extend_with(settings.ephemeris_extension)

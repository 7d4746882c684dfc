"""The one place where settings are read: every field may be set by an environment variable ``BELLA_<FIELD>``.

Read by the command line, the flows, the API and the migrations only; the science takes arguments.
"""

import os
from datetime import date
from difflib import get_close_matches
from pathlib import Path

from pydantic import Field, NonNegativeInt, PositiveFloat, PositiveInt, ValidationError, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from bella.exceptions import InputError
from bella.records import Origin

PREFIX = "BELLA_"
"""Of the environment variables of settings."""

NEAR = 0.85
"""Likeness, as difflib states it, from which a name counts as misspelt: no two settings are so alike."""

WIND_FIGURE = "wind"
"""Name of the figure that a solution has where the wind was measured."""

COLLAPSED_FIGURE = "shared-profile"
"""Name of the one that a solution has where its edge is the shared profile."""


class Settings(BaseSettings):
    """Where things are kept and how much the service takes on."""

    model_config = SettingsConfigDict(env_prefix=PREFIX, extra="ignore")

    home: Path = Field(default=Path("bella-home"), description="Folder that holds everything the service writes.")
    database_url: str | None = Field(
        default=None,
        description="SQLAlchemy URL of the catalogue, such as postgresql+psycopg://user:password@host/bella. "
        "Without it the catalogue is the file catalogue.sqlite in the home folder.",
    )
    max_pending_submissions: PositiveInt = Field(
        default=100, description="Arrival tables that may wait for the next run; further ones are asked to come later."
    )
    open_submissions: bool = Field(
        default=False, description="Whether anybody may submit arrival tables without a token."
    )
    max_submission_bytes: PositiveInt = Field(
        default=2_000_000, description="Largest arrival table that is accepted over HTTP, bytes."
    )
    heartbeat_s: float = Field(
        default=30.0, gt=0, le=60, description="Interval at which a stream of alerts says that it is alive, s."
    )
    max_streams: PositiveInt = Field(
        default=100, description="Streams of alerts that are served at a time; further ones are asked to come later."
    )
    public_url: str = Field(
        default="", description="Address of the service as its readers know it, which alerts to webhooks point to."
    )
    root_path: str = Field(
        default="",
        pattern=r"^(/[A-Za-z0-9._~-]+)*/?$",
        description="Prefix of all addresses of the service behind a proxy, such as /bella. Without it the header "
        "X-Forwarded-Prefix of a proxy on this machine is taken.",
    )
    private_webhooks: bool = Field(
        default=False,
        description="Whether alerts may be sent to addresses on this machine and in private networks, and without TLS.",
    )
    webhook_timeout_s: PositiveFloat = Field(
        default=10.0, description="Time in which a receiver of alerts must have answered, or it counts as away, s."
    )
    lease_s: PositiveFloat = Field(
        default=300.0, description="Time after which a run that has shown no sign of life counts as dead, s."
    )
    schedule_s: PositiveFloat = Field(
        default=300.0, description="Interval at which submitted arrival tables are localised, s."
    )
    workers: PositiveInt = Field(
        default=1,
        description="Processes that search days and localise bursts side by side; results do not depend on it.",
    )
    dask: str = Field(
        default="",
        description="Address of a dask scheduler, such as tcp://scheduler:8786, whose workers compute instead of "
        "processes of this machine. `workers` is then how many days are in work at a time.",
    )
    days_schedule_s: PositiveFloat = Field(
        default=600.0,
        description="Interval at which a run over the recent days begins, s; until the next one it looks at the mirror "
        "every second.",
    )
    ingest_schedule_s: PositiveFloat = Field(
        default=300.0, description="Interval at which the archives are asked for what is due, s."
    )
    mock_schedule_s: PositiveFloat = Field(
        default=3600.0, description="Interval of the mock burst that tests the whole path, s."
    )
    housekeeping_schedule_s: PositiveFloat = Field(
        default=3600.0, description="Interval at which the store is swept of what killed runs have left, s."
    )
    recent_days: NonNegativeInt = Field(
        default=0,
        description="Days before today that the schedule processes as their files come, and again where files are new; "
        "0 for none. The last spacecraft's data come after four months.",
    )
    draws: PositiveInt = Field(default=4000, description="Posterior draws kept per frequency.")
    seed: int = Field(default=20120607, description="Seed of the posterior draws; stored with every solution.")

    horizons_url: str = Field(
        default="https://ssd.jpl.nasa.gov/api/horizons.api",
        description="Address of the service that `bella update-ephemeris` asks for positions.",
    )

    archive: str = Field(
        default="https://spdf.gsfc.nasa.gov",
        description="Archive that spectra are fetched from: URL, or folder, below which pub/data is.",
    )
    regions_archive: str = Field(
        default="https://www.ngdc.noaa.gov",
        description="Archive that NOAA's Solar Region Summaries are fetched from: URL, or folder, below which stp is.",
    )
    swpc_archive: str = Field(
        default="https://services.swpc.noaa.gov",
        description="Service of NOAA/SWPC that flares of the newest days are fetched from; empty for none.",
    )
    donki_archive: str = Field(
        default="https://kauai.ccmc.gsfc.nasa.gov",
        description="Service DONKI that flares, CMEs and particle events are fetched from; empty for none.",
    )
    archive_interval_s: PositiveFloat = Field(
        default=1.0, description="Least time between two requests to the archive, s."
    )
    archive_timeout_s: PositiveFloat = Field(
        default=30.0, description="Silence of the archive after which a request counts as failed, s."
    )

    in_situ: Path | None = Field(
        default=None,
        description="Folder of hourly solar wind speeds measured in situ, which `bella fetch --follow` fills. Without "
        "it the wind of a burst is not given.",
    )
    regions: Path | None = Field(
        default=None,
        description="Folder of NOAA's Solar Region Summaries, which `bella fetch --follow` fills, and of tables of "
        "coronal holes. Without it no source regions are given.",
    )

    events: Path | None = Field(
        default=None,
        description="Folder of lists of flares, CMEs, particle events and radio bursts that others published "
        "(`docs/linked-events.md`); `bella fetch --follow` puts those of NOAA and DONKI there. Without it bursts have "
        "no linked events.",
    )

    @field_validator("in_situ", "regions", "events", mode="before")
    @classmethod
    def _unset_where_empty(cls, folder: object) -> object:
        """An empty variable is none: the path of an empty name would be the working folder."""
        return folder or None

    @property
    def catalogue_url(self) -> str:
        """SQLAlchemy URL of the catalogue."""
        return self.database_url or f"sqlite:///{(self.home / 'catalogue.sqlite').resolve()}"

    @property
    def store_root(self) -> Path:
        """Folder of the Zarr groups."""
        return self.home / "store"

    @property
    def figures_root(self) -> Path:
        """Folder of the figures, one folder per burst in it, and one for the days."""
        return self.home / "figures"

    def solution_figure(self, burst_id: str, solution_id: str, name: str) -> Path:
        """File of `WIND_FIGURE` or `COLLAPSED_FIGURE` as it is drawn, which like its solution never changes."""
        series = solution_id.removeprefix(f"{burst_id}.")
        return self.figures_root / burst_id / f"{name}-{series}.svg"

    def first_look(self, burst_id: str, solution_id: str, drawn_from: str) -> Path:
        """File of what the page of a burst shows of a solution at first; `drawn_from` is a digest."""
        series = solution_id.removeprefix(f"{burst_id}.")
        return self.figures_root / burst_id / f"page-{series}-{drawn_from}.z"

    def day_figure(self, day: date, origin: Origin = Origin.ARCHIVE) -> Path:
        """File of the figure of a searched day in data of an origin, drawn again whenever it is searched again."""
        mark = "" if origin is Origin.ARCHIVE else f"-{origin}"
        return self.figures_root / "days" / f"{day}{mark}.svg"

    @property
    def mirror_root(self) -> Path:
        """Folder of the files fetched from the archive, in the folders of the archive."""
        return self.home / "mirror"

    @property
    def incoming_root(self) -> Path:
        """Folder of the submitted arrival tables that wait for the next run."""
        return self.home / "incoming"

    @property
    def cache_root(self) -> Path:
        """Folder for what libraries cache (compiled models, fonts)."""
        return self.home / "cache"

    @property
    def ephemeris_extension(self) -> Path:
        """Table of positions after the end of the packaged one, which `bella fetch --follow` keeps up to date."""
        return self.mirror_root / "ephemeris.nc"


def make_folder(path: Path) -> None:
    """Make a folder of the home folder.

    Raises
    ------
    InputError
        If that is not possible.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        reason = "it is a file" if isinstance(error, FileExistsError) else error.strerror
        raise InputError(
            f"folder {path}: {reason}; repair it, or name another home with --home or BELLA_HOME"
        ) from error


def read_settings() -> Settings:
    """Settings of the environment.

    Raises
    ------
    InputError
        If a variable does not hold what it should, or its name is that of a setting but for a letter or two; the
        message names it.
    """
    fields = list(Settings.model_fields)
    for name in (one for one in map(str.upper, os.environ) if one.startswith(PREFIX)):
        field = name.removeprefix(PREFIX).lower()
        if field not in fields and (near := get_close_matches(field, fields, 1, NEAR)):
            raise InputError(f"{name} is no setting: {PREFIX}{near[0].upper()} is; correct or unset it")
    try:
        return Settings()
    except ValidationError as error:
        fault = error.errors()[0]
        name = f"{PREFIX}{'_'.join(map(str, fault['loc']))}".upper()
        raise InputError(f"{name} is {fault['input']!r}: {fault['msg']}; correct or unset it") from error

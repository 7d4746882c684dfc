"""The commands ``bella release make`` and ``bella release verify``: a frozen catalogue that can be cited."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bella.cli.catalogue import OriginOption, origins_of
from bella.cli.options import AsJson, Home, check_file, settings_of
from bella.cli.output import answer, new_table, print_json, show, stage_bars, steps
from bella.times import parse_day

if TYPE_CHECKING:
    from bella.formats.release import Release

release_app = typer.Typer(
    help="Freeze the catalogue into a folder that can be cited, and check one.", no_args_is_help=True
)


@release_app.command("make", epilog="Example: bella release make 2026.1 --output releases --creator 'Doe, Jane'")
def make(  # noqa: PLR0913, PLR0917 - one argument per option
    label: Annotated[str, typer.Argument(help="Label of the release, such as 2026.1.")],
    output: Annotated[Path, typer.Option(help="Folder in which the release gets one of its own.")] = Path(),
    first: Annotated[str | None, typer.Option("--from", help="First day of the onset, UTC.")] = None,
    last: Annotated[str | None, typer.Option("--to", help="Last day of the onset, UTC.")] = None,
    origin: OriginOption = None,
    posteriors: Annotated[
        bool, typer.Option("--posteriors/--no-posteriors", help="With the posteriors, which are most of its size.")
    ] = True,
    creator: Annotated[
        list[str] | None,
        typer.Option(
            help="Who made it: 'Family, Given' for a person; may be given again.", show_default="the developers"
        ),
    ] = None,
    publisher: Annotated[str | None, typer.Option(help="Who publishes it.", show_default="the first creator")] = None,
    licence: Annotated[str, typer.Option(help="Licence of the data, as SPDX names it.")] = "CC-BY-4.0",
    doi: Annotated[str | None, typer.Option(help="Its DOI, if it has one.", show_default="none")] = None,
    home: Home = None,
    as_json: AsJson = False,
) -> None:
    """Freeze the catalogue: tables, posteriors, metadata, checksums; the preferred solution of each burst."""
    from bella.formats.release import SOFTWARE
    from bella.logs import log_to
    from bella.pipeline.release import Wanted, make_release

    creators = tuple(creator or (SOFTWARE,))
    wanted = Wanted(
        label=label,
        first=None if first is None else parse_day(first, "--from"),
        last=None if last is None else parse_day(last, "--to"),
        origins=origins_of(origin),
        posteriors=posteriors,
        creators=creators,
        publisher=publisher or creators[0],
        licence=licence,
        doi=doi,
    )
    settings = settings_of(home)
    log_to(settings.home / "logs" / "bella.log")
    with stage_bars():
        release = make_release(settings, wanted, output)
    folder = output / release.name
    _say(release, folder, f"{folder.resolve()} holds {release.rows['bursts']} bursts", as_json=as_json)


@release_app.command("verify", epilog="Example: bella release verify releases/bella-2026.1")
def verify(
    folder: Annotated[Path, typer.Argument(help="Folder of the release.")],
    as_json: AsJson = False,
) -> None:
    """Check every file of a release against its checksum, and the tables against one another; needs no catalogue."""
    from bella.pipeline.release import verify_release

    check_file(folder)
    with steps("verify", sum(1 for one in folder.rglob("*") if one.is_file())) as advance:
        release = verify_release(folder, advance)
    said = f"{folder.resolve()} is whole: {release.rows['bursts']} bursts, every file as its checksum says"
    _say(release, folder, said, as_json=as_json)


def _say(release: "Release", folder: Path, line: str, *, as_json: bool) -> None:
    if as_json:
        print_json(release.model_dump(mode="json") | {"folder": str(folder.resolve())})
        return
    table = new_table(f"Release {release.release}", "table", "rows", left=("table",))
    for name, rows in (release.rows | {"posteriors": release.posteriors}).items():
        table.add_row(name, str(rows))
    show(table)
    answer(line)

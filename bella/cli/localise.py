"""The command ``bella localise``: sources of the bursts of an arrival table, without a catalogue."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bella.cli.options import (
    AsJson,
    CovarianceFile,
    MethodName,
    PresetName,
    check_file,
    check_output,
    delay_option,
    know_updates,
)
from bella.cli.output import answer, new_table, print_json, say, show, steps, write_whole
from bella.exceptions import InputError
from bella.flags import APPARENT_SOURCE

if TYPE_CHECKING:
    from rich.table import Table

EPILOG = "Example: bella localise arrivals.csv --output localisations.csv --preset default"
ROWS_SHOWN = 9
HEADER = (
    "frame",
    "reference_time",
    "edge",
    "method",
    "preset",
    "sigma_rule",
    "tau_rsun",
    "v_prior_sd_over_c",
    "kappa_prior",
    "kappa_prior_sd",
    "seed",
)
"""What the table says about itself in its first lines."""


def localise(  # noqa: PLR0913, PLR0917 - one argument per option
    arrivals: Annotated[Path, typer.Argument(help="Arrival table, CSV.")],
    output: Annotated[Path, typer.Option(help="Localisation table to write, CSV.")],
    draws: Annotated[Path | None, typer.Option(help="Zarr group to write the posterior draws to.")] = None,
    method: MethodName = "posterior",
    preset: PresetName = "default",
    dimensions: Annotated[int, typer.Option(help="2: source in the ecliptic plane. 3: anywhere in space.")] = 2,
    covariance: CovarianceFile = None,
    kappa: Annotated[
        str | None,
        typer.Option(
            help="Directional delay in half widths of the rise: MEAN,SD, or none.", show_default="that of the preset"
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Localise the bursts of an arrival table, without a catalogue."""
    from bella.arrivals import read_arrivals, read_covariance
    from bella.formats import localisation_csv, localisation_records
    from bella.multilateration import check_choices
    from bella.multilateration import localise as locate

    check_choices(preset, method, dimensions)
    check_output(output)
    if draws is not None:
        if draws.exists():
            raise InputError(f"{draws} exists and is never overwritten; name another --draws")
        check_output(draws, "--draws")
    delay = delay_option(kappa)
    for path in filter(None, (arrivals, covariance)):
        check_file(path)
    know_updates()
    table = read_arrivals(arrivals)
    measured = None if covariance is None else read_covariance(covariance, len(table))
    with steps("localise", table["frequency_mhz"].nunique()) as advance:
        posterior = locate(
            table,
            method=method,
            preset=preset,
            dimensions=dimensions,
            covariance_s2=measured,
            delay=delay,
            advance=advance,
        )
    if draws is not None:
        from bella.store import write_group

        write_group(posterior, draws)
    records = localisation_records(posterior)
    comments = {name: posterior.attrs[name] for name in HEADER} | {"remark": APPARENT_SOURCE}
    write_whole(output, localisation_csv(records, comments))
    if as_json:
        print_json({"header": comments, "localisations": [dict(one) for one in records]})
        return
    show(position_table("", records))
    say(f"Table  {output}")
    answer(_answer(records))


def position_table(title: str, records: Sequence[Mapping[str, Any]]) -> "Table":
    """Positions of a solution, at most nine.

    Parameters
    ----------
    records : sequence of mapping
        One per frequency, with the columns of the localisation table.
    """
    table = new_table(title, "MHz", "R_sun", "longitude", "sd x, y", "68 % area", "emitted", "speed")
    by_frequency = sorted(records, key=lambda one: -float(one["frequency_mhz"]))
    shown = min(ROWS_SHOWN, len(by_frequency))
    for i in range(shown):
        table.add_row(*_cells(by_frequency[round((len(by_frequency) - 1) * i / max(shown - 1, 1))]))
    table.caption = f"{APPARENT_SOURCE}\nn.c.: not constrained (share of the prior's width that is left)"
    return table


def _cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    constrained = "speed_not_constrained" not in row["flags"]
    speed = f"{row['v_over_c']:.3f} c" if constrained else f"n.c. ({row['contraction_v']:.2f})"
    return (
        f"{row['frequency_mhz']:.3f}",
        f"{_range_rsun(row):.1f}",
        f"{_longitude_deg(row):+.1f}°",
        f"{math.sqrt(row['cov_xx_rsun2']):.1f}, {math.sqrt(row['cov_yy_rsun2']):.1f}",
        f"{row['area68_rsun2']:.0f}",
        f"{row['emission_utc']:%H:%M:%S}",
        speed,
    )


def _range_rsun(row: Mapping[str, Any]) -> float:
    return math.hypot(row["x_rsun"], row["y_rsun"])


def _longitude_deg(row: Mapping[str, Any]) -> float:
    return math.degrees(math.atan2(row["y_rsun"], row["x_rsun"]))


def _answer(records: Sequence[Mapping[str, Any]]) -> str:
    high, low = (choose(records, key=lambda one: float(one["frequency_mhz"])) for choose in (max, min))
    if high is low:
        where = f"at {_range_rsun(high):.0f} R_sun and longitude {_longitude_deg(high):.0f}° (HEE)"
        return f"One source at {high['frequency_mhz']:.3g} MHz {where}"
    return (
        f"Sources at {len(records)} frequencies: from {_range_rsun(high):.0f} R_sun and longitude "
        f"{_longitude_deg(high):.0f}° at {high['frequency_mhz']:.3g} MHz to {_range_rsun(low):.0f} R_sun and "
        f"{_longitude_deg(low):.0f}° at {low['frequency_mhz']:.3g} MHz (HEE)"
    )

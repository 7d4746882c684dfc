"""Addresses of bursts, solutions and days."""

from datetime import date, timedelta
from urllib.parse import urlencode

from api.links import linked
from bella.catalogue import Burst, Solution
from bella.records import REAL_ORIGINS, Origin

API = "/api/v1"


def zarr_path(solution: Solution) -> str:
    """Address path of the Zarr group of a solution."""
    return f"{API}/solutions/{solution.solution_id}/posterior.zarr"


def figure_path(solution: Solution, name: str) -> str:
    """Address path of a figure of a solution."""
    return linked(f"{API}/solutions/{solution.solution_id}/figures/{name}")


def day_links(day: date, origin: Origin = Origin.ARCHIVE) -> dict[str, str]:
    """Addresses of everything about a searched day; those of simulated and test data ask for their origin."""
    base = linked(f"{API}/days/{day}")
    asked = {} if origin in REAL_ORIGINS else {"origin": origin.value}
    received = urlencode({"start": day, "stop": day + timedelta(days=1), **asked})
    tail = f"?{urlencode(asked)}" if asked else ""
    return {
        "self": f"{base}{tail}",
        "page": linked(f"/days/{day}{tail}"),
        "figure": f"{base}/figure.svg{tail}",
        "detections": linked(f"{API}/detections?{received}"),
    }


def burst_links(burst: Burst) -> dict[str, str]:
    """Addresses of everything about a burst."""
    base = linked(f"{API}/bursts/{burst.burst_id}")
    parts = ("versions", "track", "posterior", "events")
    figures = {f"figure_{name}": f"{base}/figures/{name}.svg" for name in ("constellation", "spectra")}
    return {
        "self": base,
        "page": linked(f"/bursts/{burst.burst_id}"),
        **{part: f"{base}/{part}" for part in parts},
        **figures,
    }

"""Which burst of the catalogue a burst of a day is: the nearest, and only one."""

from contextlib import closing
from datetime import timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pandas as pd

from bella.catalogue import Catalogue
from flows.days import known_burst_ids
from tests.catalogue.examples import publication


def heard(name: str, start: pd.Timestamp) -> Any:
    return SimpleNamespace(burst_id=name, start_utc=start)


def test_a_burst_keeps_its_name_and_lends_it_to_no_other(tmp_path: Path) -> None:
    known = publication()
    onset = pd.Timestamp(known.burst.start_utc).tz_localize(None)
    with closing(Catalogue.open(f"sqlite:///{tmp_path / 'catalogue.sqlite'}", create=True)) as catalogue:
        catalogue.publish(known)
        near, nearer = heard("near", onset + timedelta(minutes=6)), heard("nearer", onset - timedelta(minutes=2))
        far = heard("far", onset + timedelta(hours=2))

        names = known_burst_ids(catalogue, [near, nearer, far])

    assert names == {"near": "near", "nearer": known.burst.burst_id, "far": "far"}

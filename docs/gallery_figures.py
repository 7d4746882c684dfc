"""Figures of the package in the gallery of examples: each stands below the lines that make it."""

from pathlib import Path
from typing import Any

from sphinx_gallery.scrapers import figure_rst

from bella.plotting import Figure

_shown: dict[int, Figure] = {}
"""Figures of the blocks before, by their identity: an example keeps its names from block to block."""


def scraped(_: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Write the new figures of a block, and return what the page shows of them."""
    made = {id(one): one for one in block_vars["example_globals"].values() if isinstance(one, Figure)}
    files = []
    for drawn in (one for key, one in made.items() if key not in _shown):
        path = Path(next(block_vars["image_path_iterator"])).with_suffix(".svg")
        drawn.save(path)
        files.append(str(path))
    _shown.update(made)
    return figure_rst(files, gallery_conf["src_dir"]) if files else ""

"""How the documentation is built: ``make docs``. No page needs a network, neither to be built nor to be read."""

import os
import sys
import zlib
from pathlib import Path
from typing import Any

import matplotlib as mpl

import bella

sys.path.insert(0, str(Path(__file__).parent))
from tables import with_tables

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
mpl.use("Agg")

HERE = Path(__file__).parent

project = "BELLA"
author = "The BELLA service developers"
copyright = f"2024-2026, {author}"  # noqa: A001 - the name that Sphinx reads
version = release = bella.__version__

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.intersphinx",
    "sphinx.ext.viewcode",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
]
exclude_patterns = ["_build", "examples", "**.ipynb"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
nitpicky = True
nitpick_ignore_regex = [
    (r"py:(func|meth|attr|data|mod|obj|exc|const)", ".*")
]  # docstrings may name what has no page here

myst_enable_extensions = ["colon_fence", "deflist"]
myst_heading_anchors = 4

autodoc_typehints = "none"  # the docstrings name the types, in the reader's words
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True}
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

html_theme = "pydata_sphinx_theme"
html_title = f"BELLA {release}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_sidebars = {"tutorial": [], "reading-a-burst": []}  # they have no pages below
html_theme_options = {
    "show_prev_next": True,
    "navigation_with_keys": False,
    "header_links_before_dropdown": 7,
    "secondary_sidebar_items": ["page-toc"],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}
html_context = {"default_mode": "auto"}


sphinx_gallery_conf = {
    "examples_dirs": "examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"/plot_",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "remove_config_comments": True,
    "show_memory": False,
    "min_reported_time": 0,
    "image_scrapers": ("matplotlib", "gallery_figures.scraped"),
    "abort_on_example_error": True,
    "doc_module": ("bella",),
    "backreferences_dir": None,
    "plot_gallery": True,
}

# Names of other projects that our docstrings use, and their pages. Their whole inventories would have to be downloaded
# at every build; these few lines do without.
ELSEWHERE = {
    "https://docs.python.org/3/": {
        "pathlib.Path": "library/pathlib.html",
        "datetime.date": "library/datetime.html",
        "datetime.datetime": "library/datetime.html",
        "collections.abc.Callable": "library/collections.abc.html",
    },
    "https://numpy.org/doc/stable/": {
        "numpy.ndarray": "reference/generated/numpy.ndarray.html",
        "numpy.datetime64": "reference/arrays.scalars.html",
        "numpy.random._generator.Generator": "reference/random/generator.html",
    },
    "https://pandas.pydata.org/docs/": {"pandas.DataFrame": "reference/api/pandas.DataFrame.html"},
    "https://docs.xarray.dev/en/stable/": {
        "xarray.Dataset": "generated/xarray.Dataset.html",
        "xarray.DataTree": "generated/xarray.DataTree.html",
        "xarray.open_zarr": "generated/xarray.open_zarr.html",
    },
    "https://docs.astropy.org/en/stable/": {
        "astropy.table.Table": "api/astropy.table.Table.html",
        "astropy.table.QTable": "api/astropy.table.QTable.html",
        "astropy.time.Time": "api/astropy.time.Time.html",
        "astropy.units.Quantity": "api/astropy.units.Quantity.html",
        "astropy.coordinates.SkyCoord": "api/astropy.coordinates.SkyCoord.html",
    },
    "https://docs.sunpy.org/en/stable/": {
        "sunpy.coordinates.HeliocentricEarthEcliptic": (
            "generated/api/sunpy.coordinates.HeliocentricEarthEcliptic.html"
        ),
    },
}


def inventories(folder: Path) -> dict[str, tuple[str, str]]:
    """Write an inventory for each of `ELSEWHERE`, in the form that Sphinx reads."""
    folder.mkdir(parents=True, exist_ok=True)
    mapping = {}
    for number, (url, pages) in enumerate(ELSEWHERE.items()):
        file = folder / f"{number}.inv"
        head = "# Sphinx inventory version 2\n# Project: x\n# Version: x\n# The rest is compressed using zlib.\n"
        rows = "".join(f"{name} py:class 1 {page}#{name} -\n" for name, page in pages.items())
        file.write_bytes(head.encode() + zlib.compress(rows.encode()))
        mapping[f"site{number}"] = (url, str(file))
    return mapping


intersphinx_mapping = inventories(HERE / "_build" / "inventories")


def fill_in_tables(app: Any, name: str, source: list[str]) -> None:  # noqa: ARG001 - Sphinx gives all three
    """Put tables that are made of the package where a page asks for them."""
    source[0] = with_tables(source[0])


def setup(app: Any) -> None:
    """Sphinx calls this once."""
    app.connect("source-read", fill_in_tables)

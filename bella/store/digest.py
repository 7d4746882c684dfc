"""Content of a group as bytes: what is compared after writing and what the checksum in the catalogue covers.

Two groups have the same content when their variables agree in name, dimensions, type, shape and every byte, and
their attributes agree as JSON. Compression, chunks and byte order on disk do not count.
"""

import hashlib
import json
from collections.abc import Iterator
from typing import Any

import numpy as np
import xarray as xr

_TEXT = "text"


def datasets_of(group: xr.Dataset | xr.DataTree) -> Iterator[tuple[str, xr.Dataset]]:
    """Walk the datasets of a group.

    Parameters
    ----------
    group : xarray.Dataset or xarray.DataTree
        A dataset counts as a tree with a root only.

    Yields
    ------
    path : str
        Path of the node, "/" for the root.
    dataset : xarray.Dataset
        Variables of the node itself, without inherited coordinates.
    """
    if isinstance(group, xr.Dataset):
        yield "/", group
        return
    for node in sorted(group.subtree, key=lambda node: node.path):
        yield node.path, node.to_dataset(inherit=False)


def is_text(values: np.ndarray[Any, Any]) -> bool:
    """Tell whether an array holds text, in whichever of numpy's three ways."""
    return values.dtype.kind in "UT" or (
        values.dtype.kind == "O" and all(isinstance(value, str) for value in values.ravel())
    )


def variable_bytes(variable: xr.Variable) -> tuple[str, bytes]:
    """Type and bytes of a variable in a form that does not depend on the machine.

    Parameters
    ----------
    variable : xarray.Variable
        Any numeric, boolean, datetime64 or text variable, shape as is.

    Returns
    -------
    dtype : str
        Little-endian numpy type, times in ns, or "text".
    content : bytes
        C-ordered values; text as a JSON list.
    """
    values = np.asarray(variable.values)
    if is_text(values):
        return _TEXT, json.dumps([str(value) for value in values.ravel()]).encode()
    if values.dtype.kind in "mM":
        values = values.astype(f"{values.dtype.kind}8[ns]")
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    return little.dtype.str, little.tobytes()


def attributes_json(attributes: dict[Any, Any]) -> str:
    """Attributes as JSON with sorted keys; numpy scalars and arrays become numbers and lists."""
    return json.dumps(attributes, sort_keys=True, default=lambda value: value.tolist())


def content_lines(group: xr.Dataset | xr.DataTree) -> dict[str, str]:
    """Digest of each variable and each set of attributes of a group.

    Parameters
    ----------
    group : xarray.Dataset or xarray.DataTree
        Content to digest; lazily opened variables are read.

    Returns
    -------
    dict of str to str
        Path of the variable (or node) to its type, dimensions, shape and sha256.
    """
    lines: dict[str, str] = {}
    for path, dataset in datasets_of(group):
        lines[path] = attributes_json(dataset.attrs)
        for name, variable in dataset.variables.items():
            dtype, content = variable_bytes(variable)
            header = [dtype, list(variable.dims), list(variable.shape), attributes_json(variable.attrs)]
            lines[f"{path.rstrip('/')}/{name}"] = f"{json.dumps(header)} {hashlib.sha256(content).hexdigest()}"
    return lines


def content_sha256(group: xr.Dataset | xr.DataTree) -> str:
    """Checksum of the content of a group, the same for any compression and on any machine.

    Parameters
    ----------
    group : xarray.Dataset or xarray.DataTree
        Content to digest; lazily opened variables are read.

    Returns
    -------
    str
        64 hexadecimal digits.
    """
    return sha256_of_lines(content_lines(group))


def sha256_of_lines(lines: dict[str, str]) -> str:
    """Checksum of what `content_lines` returned."""
    return hashlib.sha256("\n".join(f"{name} {lines[name]}" for name in sorted(lines)).encode()).hexdigest()

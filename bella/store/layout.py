"""Where groups lie on disk: staging, placing, sweeping, and paths that may not leave the root."""

import os
import re
import shutil
import time
import uuid
from collections.abc import Collection, Iterator
from pathlib import Path

import structlog

from bella.exceptions import StoreError

STAGING = ".staging"
SUFFIX, FOLDER = ".zarr.zip", ".zarr"
"""How the name of a group ends; and how it did up to version 0.2, when each was a folder of a hundred files."""

_COMPONENT = re.compile(r"[A-Za-z0-9_][A-Za-z0-9._-]*")

log = structlog.get_logger(__name__)


def inside(root: Path, store_path: str, suffix: str = SUFFIX) -> Path:
    """Path of a group below the root.

    Parameters
    ----------
    store_path : str
        Path of the group relative to the root, with forward slashes.
    suffix : str
        How its name must end.

    Returns
    -------
    Path
        Absolute path; links are followed.

    Raises
    ------
    StoreError
        Where the path is absolute, hidden, or leads out of the root.
    """
    components = store_path.split("/")
    target = (root.resolve() / store_path).resolve() if "\0" not in store_path else root
    well_formed = all(_COMPONENT.fullmatch(component) for component in components)
    if well_formed and components[-1].endswith(FOLDER) and suffix != FOLDER:
        raise StoreError(f"{store_path} is a folder, as older versions stored groups: run `bella store pack` once")
    if not well_formed or not components[-1].endswith(suffix) or not target.is_relative_to(root.resolve()):
        raise StoreError(f"{store_path!r} is not a path of a group in the store: give one as <burst id>/<name>{suffix}")
    return target


def flush(path: Path) -> None:
    """Wait until a file or directory has reached the disk.

    Raises
    ------
    OSError
        Where the disk refuses.
    """
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def flush_tree(path: Path) -> None:
    """Make every file below a directory read-only and wait until all of it has reached the disk.

    The directories stay writable.
    """
    for folder, _, names in os.walk(path, topdown=False):
        for name in names:
            file = Path(folder) / name
            flush(file)
            file.chmod(0o444)
        flush(Path(folder))


def place_group(staged: Path, root: Path, name: str) -> str:
    """Give a staged and verified group its final name.

    Parameters
    ----------
    staged : Path
        What `stage_group` returned.
    name : str
        New and unique path below the root, such as
        ``T3-20120607-1929/half_maximum-posterior-default-2d-3f9c.zarr.zip``.

    Returns
    -------
    str
        The path relative to the root, as the catalogue keeps it.

    Raises
    ------
    StoreError
        Where the name is taken or leads out of the root, or the disk refuses.
    """
    target = inside(root, name)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        target.hardlink_to(staged)  # unlike a rename, it never takes the place of another
        staged.unlink()
        for folder in (staged.parent, *target.parents):
            if folder.is_relative_to(root.resolve()):
                flush(folder)
    except FileExistsError as error:
        raise StoreError(
            f"{name} is in the store already and groups are never replaced: place it under a new name"
        ) from error
    except OSError as error:
        raise StoreError(f"{name} could not be placed ({error.strerror}): free the disk and run again") from error
    log.info("group placed", store_path=name)
    return name


def age_s(group: Path, now: float) -> float:
    """Seconds since a group, or anything in a folder, was last written, placed or renamed."""
    times = [group.stat().st_mtime, group.stat().st_ctime]
    for folder, _, names in os.walk(group):
        times.append(Path(folder).stat().st_mtime)
        times.extend((Path(folder) / name).stat().st_mtime for name in names)
    return now - max(times)


def placed_groups(root: Path) -> Iterator[str]:
    """Paths of all placed groups relative to the root, those of older versions among them."""
    for folder, names, files in os.walk(root):
        folders = [name for name in names if name.endswith(FOLDER)]
        names[:] = [name for name in names if name not in folders and not name.startswith(".")]
        for name in sorted([*folders, *(name for name in files if name.endswith(SUFFIX))]):
            yield (Path(folder) / name).relative_to(root).as_posix()


def sweep(
    root: Path, referenced: Collection[str], older_than_s: float, in_use: Collection[str] = frozenset()
) -> list[str]:
    """Remove what writers that were killed left behind.

    Parameters
    ----------
    referenced : collection of str
        Store paths the catalogue refers to; these are never removed. Read them before calling.
    older_than_s : float
        Groups in which anything changed within this time belong to a writer that may be alive, s.
    in_use : collection of str
        Folders below the root, such as burst ids, that live writers work on: what is placed there stays, whatever its
        age. Read them before calling.

    Returns
    -------
    list of str
        Removed paths relative to the root.
    """
    root = root.resolve()
    now = time.time()
    staged = [f"{STAGING}/{path.name}" for path in sorted((root / STAGING).glob("*"))]
    placed = (path for path in placed_groups(root) if path.partition("/")[0] not in in_use)
    orphans = [path for path in placed if path not in referenced]
    removed = [path for path in (*staged, *orphans) if _remove(root, path, now, older_than_s)]
    if removed:
        log.info("store swept", removed=removed)
    return removed


def _remove(root: Path, path: str, now: float, older_than_s: float) -> bool:
    """Remove one group in a way that never shows half of it; False where it is young or already gone."""
    try:
        if age_s(root / path, now) < older_than_s:
            return False
        doomed = root / STAGING / f"{uuid.uuid4().hex}.swept"
        doomed.parent.mkdir(exist_ok=True)
        (root / path).rename(doomed)
    except FileNotFoundError:
        return False
    if doomed.is_dir():
        shutil.rmtree(doomed, ignore_errors=True)
    else:
        doomed.unlink(missing_ok=True)
    return True

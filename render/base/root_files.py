"""Change files below the root of a show, and follow no link out of it.

A show may come from somebody else, with links in place of the folders that we write to. So each folder, from
the root on, is opened in the one before it, where a link is refused. Files are changed in the folder that is
held open, whatever takes its place meanwhile. Systems that cannot hold folders have them checked before.

This concerns the folders of OWNED, in which we choose the names. What users name themselves (`-o`), what
lies above the root, and what is only read may be links. A link in place of a file is itself replaced or
removed.

The store may be a link to another disk if the folder there has the same `store.id` as `.flowsculpt`: a show
can bring along a link, but no file in a folder of the user's.
"""

from __future__ import annotations

import os
import secrets
import shlex
import shutil
import stat
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import IO, Any

from flowsculpt.render.base.render_errors import MachineError

OWNED = (".flowsculpt", ".snakemake", "renders", "bred", "notes")
"""Folders of a root in which no link is followed."""

STORE = (".flowsculpt", "store")
"""The folder that may be a link."""

SCRATCH = (".flowsculpt", "tmp")
"""The folder for drafts, from which each run removes those of killed processes."""

IDENTITY = "store.id"
"""The file by which a store on another disk is known as that of a root."""

_NO_LINK = getattr(os, "O_NOFOLLOW", 0)
_FOLDER = getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_PATH", 0)
_CAN_HOLD = Path("/proc/self/fd").is_dir()
_roots: set[str] = set()
"""Absolute paths that end with a slash."""


def guard(root: Path) -> None:
    """Follow no link below a root from now on, in this process and in those that it forks."""
    _roots.add(os.path.join(os.path.abspath(root), ""))  # noqa: PTH100, PTH118


def scratch_of(path: Path) -> Path | None:
    """Return the folder for drafts of a file that a root's state consists of; None for all other files.

    The store may lie on another disk, and has a folder for drafts of its own.
    """
    root, names = _split_at_root(path)
    is_state = names[:1] == [SCRATCH[0]] and tuple(names[:2]) != STORE
    return root.joinpath(*SCRATCH) if is_state else None


@contextmanager
def held(folder: Path, make: bool = False) -> Iterator[Path]:
    """Yield a path that is this folder's until the block ends, also if a link takes its place.

    make  make it, and the folders above it, where they are missing

    Raises MachineError where it or a folder between it and its root is a link, and OSError.
    """
    root, names = _split_at_root(folder)
    if make:
        root.mkdir(parents=True, exist_ok=True)
    place, descriptor = root, -1
    try:
        for count in range(1, len(names) + 1):
            outer, descriptor = descriptor, _open_inner(place, root, names[:count], make)
            if outer >= 0:
                os.close(outer)
            place = _descriptor_path(descriptor) if _CAN_HOLD else place / names[count - 1]
        yield place
    except OSError as error:
        if isinstance(error.filename, str) and names:  # say the name that people know
            error.filename = error.filename.replace(str(place), str(folder))
        raise
    finally:
        if descriptor >= 0:
            os.close(descriptor)


def open_file(path: Path, flags: int) -> int:
    """Open a file as `os.open` does, and return its descriptor. Missing folders are made for a new one.

    Raises MachineError where it is a link, too, and OSError.
    """
    is_owned = bool(_split_at_root(path)[1])
    with held(path.parent, make=bool(flags & os.O_CREAT)) as folder:
        place = folder / path.name
        if is_owned and place.is_symlink():
            raise _refusal(path, place)
        return os.open(place, flags | (_NO_LINK if is_owned else 0), 0o666)


def appended(path: Path) -> IO[bytes]:
    """Open a file to add to its end, and to read. Raises as `open_file` does."""
    return open(open_file(path, os.O_RDWR | os.O_CREAT | os.O_APPEND), "a+b", buffering=0)


def touch(path: Path) -> None:
    """Make an empty file where there is none. Raises as `open_file` does."""
    os.close(open_file(path, os.O_WRONLY | os.O_CREAT))


def set_time(path: Path, when: float) -> None:
    """Set the times of a file, or of the link in its place, in seconds since the epoch. Raises as `held`."""
    with held(path.parent) as folder:
        follow = os.utime not in os.supports_follow_symlinks
        os.utime(folder / path.name, (when, when), follow_symlinks=follow)


def remove_file(path: Path, prune: bool = False) -> None:
    """Remove a file, or the link in its place, if there is one. Raises as `held` does.

    prune  remove folders that are empty then, too
    """
    with suppress(FileNotFoundError, NotADirectoryError), held(path.parent) as folder:
        (folder / path.name).unlink()
    with suppress(OSError):  # others are in it
        for inner in path.parents if prune else ():
            with held(inner.parent) as folder:
                (folder / inner.name).rmdir()


def remove_tree(path: Path) -> None:
    """Remove a folder with all in it, a file, or the link in its place, as far as the disk allows."""
    with suppress(OSError), held(path.parent) as folder:
        place = folder / path.name
        if place.is_dir() and not place.is_symlink():
            shutil.rmtree(place, ignore_errors=True)
        else:
            place.unlink()


def require_own_folders(root: Path) -> None:
    """Raise MachineError where a folder that runs change is a link; let the store be known."""
    with suppress(OSError):  # of a disk that is full or only read
        _identify_store(root.joinpath(*STORE))
    for name in OWNED:
        with suppress(FileNotFoundError), held(root / name) as folder:
            inner = os.listdir(folder) if name.startswith(".") else ()  # noqa: PTH208
            for path in (root / name / each for each in inner):
                if path.is_symlink():
                    with held(path):  # raises, except for the store
                        pass


def _identify_store(store: Path) -> None:
    """Write the file by which the store is known once it is moved to another disk."""
    with held(store.parent, make=True) as state:
        ours = _identity(state) or secrets.token_hex(16).encode()
        is_moved = (state / store.name).is_symlink()
        with nullcontext() if is_moved else held(store, make=True) as folder:
            for place in (state, folder or state):
                if _identity(place) != ours:
                    (place / IDENTITY).unlink(missing_ok=True)
                    (place / IDENTITY).write_bytes(ours)


def _identity(folder: Path) -> bytes:
    """Return what the file of a folder says; nothing where it has none, or a link."""
    with suppress(OSError):
        if stat.S_ISREG((folder / IDENTITY).lstat().st_mode):
            return (folder / IDENTITY).read_bytes()
    return b""


def _split_at_root(path: Path) -> tuple[Path, list[str]]:
    """Return the root of a path and the names from there on; no names where links may be followed."""
    whole = os.path.abspath(path)  # noqa: PTH100  # `absolute` keeps `..`
    for root in sorted(_roots):  # of one in another, the outer one
        if whole.startswith(root) and (names := [*Path(whole[len(root) :]).parts])[:1] and names[0] in OWNED:
            return Path(root), names
    return path, []


def _open_inner(outer: Path, root: Path, names: Sequence[str], make: bool) -> int:
    """Return the descriptor of the last of `names`, in a folder; -1 where the system has none."""
    place = outer / names[-1]
    if make:
        with suppress(FileExistsError):
            place.mkdir()
    is_moved_store = tuple(names) == STORE and place.is_symlink()
    if place.is_symlink() and not is_moved_store:
        raise _refusal(root.joinpath(*names), place)
    descriptor = os.open(place, _FOLDER | (0 if is_moved_store else _NO_LINK)) if _CAN_HOLD else -1
    opened = _descriptor_path(descriptor) if _CAN_HOLD else place
    if is_moved_store and not (_identity(outer) and _identity(outer) == _identity(opened)):
        if _CAN_HOLD:
            os.close(descriptor)
        raise _refusal(root.joinpath(*names), place)
    return descriptor


def _descriptor_path(descriptor: int) -> Path:
    """Return the path of a folder that this process holds, which is right in its child processes too."""
    return Path(f"/proc/{os.getpid()}/fd/{descriptor}")


def _refusal(path: Path, link: Path) -> MachineError:
    target, remedy = link.readlink(), "remove the link, or mount that folder there"
    if path.parts[-2:] == STORE:
        copy = shlex.join(["cp", str(path.with_name(IDENTITY)), str(path.parent / target)])
        remedy += f", or, if it is this show's store, run: {copy}"
    return MachineError(f"{path} is a link to {target}; flowsculpt changes nothing through links; {remedy}")


_THROUGH = ("open", "os.truncate", "sqlite3.connect")
"""Audit events of changes to a file that follow a link in its place."""

_IN_FOLDERS = ("os.chmod", "os.mkdir", "os.remove", "os.rmdir", "os.utime", "shutil.rmtree")
"""Those that change an entry of a folder; _OF_TWO are of two folders."""

_OF_TWO = ("os.link", "os.rename", "os.symlink")


def forbid_links() -> None:
    """Have libraries that change files themselves raise MachineError where they would follow a link."""

    def check(event: str, about: tuple[Any, ...]) -> None:
        if event == "open" and not about[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            return
        count = 2 if event in _OF_TWO else int(event in _THROUGH or event in _IN_FOLDERS)
        for path in (Path(os.fsdecode(path)) for path in about[:count] if not isinstance(path, int)):
            if len(_split_at_root(path)[1]) > 1:
                with suppress(OSError), held(path.parent) as folder:
                    if event in _THROUGH and (folder / path.name).is_symlink():
                        raise _refusal(path, folder / path.name)

    sys.addaudithook(check)

"""A file is replaced only while it holds what was read from it, whenever somebody else saves it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from flowsculpt.render.base.atomic_write import ChangedFileError, atomic_write


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "a.yaml"


def replaced(path: Path, read: str | None, *saves: Callable[[], object]) -> bool:
    """Replace what was read, while others save after each comparison; tell whether it was replaced."""
    waiting = list(saves)

    def is_same(there: Path) -> bool:
        same = (there.read_text() if there.exists() else None) == read
        if waiting:
            waiting.pop(0)()
        return same

    try:
        with atomic_write(path, is_same=is_same) as draft:
            draft.write_text("ours")
    except ChangedFileError:
        return False
    finally:
        assert list(path.parent.iterdir()) == [path], "nothing is left beside it"
    return True


def rename(path: Path, text: str) -> Callable[[], object]:
    beside = path.with_suffix(".new")
    return lambda: (beside.write_text(text), beside.replace(path))


def in_place(path: Path, text: str) -> Callable[[], object]:
    return lambda: path.write_text(text)


def test_what_is_as_it_was_read_is_replaced(path: Path) -> None:
    assert replaced(path, None) and path.read_text() == "ours"
    path.write_text("before")
    assert replaced(path, "before") and path.read_text() == "ours"
    assert not replaced(path, "before") and path.read_text() == "ours"


@pytest.mark.parametrize("save", [rename, in_place])
@pytest.mark.parametrize("read", ["before", None])
def test_what_is_saved_after_the_comparison_is_kept(
    save: Callable[[Path, str], Callable[[], object]], read: str | None, path: Path
) -> None:
    if read is not None:
        path.write_text(read)
    assert not replaced(path, read, save(path, "theirs"))
    assert path.read_text() == "theirs"


@pytest.mark.parametrize("save", [rename, in_place])
def test_of_two_texts_saved_within_microseconds_the_last_is_kept(
    save: Callable[[Path, str], Callable[[], object]], path: Path
) -> None:
    path.write_text("before")
    assert not replaced(path, "before", save(path, "first"), save(path, "second"))
    assert path.read_text() == "second"


def test_a_file_that_is_moved_away_at_the_last_moment_has_changed(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path.write_text("before")
    monkeypatch.setattr(Path, "exists", lambda there: True)
    moved_away = atomic_write(path, is_same=lambda there: path.unlink() is None)
    with pytest.raises(ChangedFileError), moved_away as draft:
        draft.write_text("ours")
    assert not list(path.parent.iterdir())

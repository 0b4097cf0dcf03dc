"""What an edit shows, as planning sees it: how it is cut, and which frames of which shots.

Finding it reads every shot, so the ledger remembers it, with what it goes by of each of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import FlowsculptError
from pipeline.production.request.edit import Edit
from pipeline.production.request.planning_cache import PlanningCache
from pipeline.production.request.shot_summary import ShotSummary

if TYPE_CHECKING:
    from pipeline.shot import Film

OutlineOf = Callable[[Path], ShotSummary]
"""What a shot file is, as planning sees it."""


@dataclass(frozen=True)
class ResolvedEdit:
    """A film's cut, and its clips in order.

    clips  of each the shot file, its place in full, and the frames that are shown
    shots  of each clip the frames and the rate of its shot, which are all that an edit goes by
    """

    edit: Edit
    clips: tuple[tuple[Path, tuple[int, ...]], ...]
    shots: tuple[tuple[tuple[int, ...], str], ...]

    @classmethod
    def of(cls, film: Film, name: str) -> ResolvedEdit:
        clips = [(clip.shot.path, clip.frames.numbers) for clip in film.clips]
        shots = [(clip.shot.frames.numbers, str(clip.shot.rate)) for clip in film.clips]
        return cls(
            Edit.of(film, name),
            tuple((path.absolute(), frames) for path, frames in clips if path is not None),
            tuple(shots),
        )

    def holds(self, outline_of: OutlineOf) -> bool:
        """Whether its shots, and its sound, are still what it goes by. Raises what reading a shot raises."""
        outlines = (outline_of(path) for path, _ in self.clips)
        same = all((each.frames, each.rate) == shot for each, shot in zip(outlines, self.shots, strict=True))
        return same and (self.edit.audio is None or self.edit.audio.is_unchanged)

    def as_data(self) -> dict[str, Any]:
        return {
            "cut": self.edit.as_data(),
            "clips": [[str(path), frames] for path, frames in self.clips],
            "shots": self.shots,
        }

    @classmethod
    def from_data(cls, data: Mapping[str, Any]) -> ResolvedEdit:
        return cls(
            Edit.from_data(data["cut"]),
            tuple((Path(path), tuple(frames)) for path, frames in data["clips"]),
            tuple((tuple(frames), rate) for frames, rate in data["shots"]),
        )


def edited(
    path: Path, settings: tuple[str, ...], ledger: PlanningCache, outline_of: OutlineOf
) -> ResolvedEdit:
    """What the edit at `path` shows, with settings in its shots.

    Raises what `read_film` raises.
    """
    text = _text(path)
    found_from = "film", text, str(path.absolute()), settings
    known = None if text is None else ledger.recall(*found_from)
    if known is not None:
        montage = ResolvedEdit.from_data(known)
        with suppress(FlowsculptError):  # all that is wrong is told where all is read
            if montage.holds(outline_of):
                return montage
    from pipeline.shot import read_film

    montage = ResolvedEdit.of(read_film(path, settings, text), path.stem)
    ledger.note(montage.as_data(), *found_from)
    return montage


def _text(path: Path) -> str | None:
    """None where it cannot be read, which whoever reads it tells."""
    with suppress(OSError, UnicodeDecodeError):
        return path.read_text(encoding="utf-8")
    return None

"""The contract of plug-ins for what they have of a shot besides its frames: the door `extras`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from flowsculpt.pipeline.plugin import plugins

if TYPE_CHECKING:  # `clean` and `schema` need none of them, and importing them takes time
    from pydantic import BaseModel

    from flowsculpt.pipeline.production.picture_sequences import PictureSequence, SequenceGrid, SequenceQuery
    from flowsculpt.pipeline.production.request.render_request import RenderRequest
    from flowsculpt.pipeline.production.store.store import Key, Store


@dataclass(frozen=True)
class Animation:
    """Frames of a shot as one mesh of each subject, whose vertices move.

    key  a digest of all that decides the content
    glb  returns a GLB whose clip begins at the first frame, of morph targets blended two at a time; takes a
         function of the name of a part of the work and its number of steps, which returns what to call after
         each
    """

    key: str
    glb: Callable[[Callable[[str, int], Callable[[], None]]], bytes]


@dataclass(frozen=True)
class PublishedFile:
    """A file of a published version.

    version  the folder of its version
    number   its frame number; None if it is not a frame
    digest   SHA-256 that it had when it was published
    fault    what is wrong with it, if that is known
    """

    path: Path
    version: Path
    number: int | None = None
    digest: str = ""
    fault: str | None = None


class ShotExtras:
    """What a plug-in has of a shot besides its frames. Its class overrides what it has; the rest is empty.

    An object of the class is made without arguments, once in a process. Other plug-ins ask all of them:
    `review` shows sequences and animations, `publish` freezes notes, `clean` deletes what is unneeded, and
    `verify` checks published files. Keep
    the module of the class small and import in its methods: each of these commands imports it.
    """

    def sequences(self, query: SequenceQuery) -> Iterable[PictureSequence | SequenceGrid]:
        """Yield picture sequences of the shot of a query, and grids of them, for the review page."""
        return ()

    def animation(self, request: RenderRequest, store: Store, most_vertices: int) -> Animation | None:
        """Return the frames of a request as an animation; None where the plug-in makes none.

        most_vertices  of each subject

        Raises FlowsculptError where the shot has none; its message says why.
        """
        return None

    def notes(self, root: Path, shot: str) -> bytes:
        """Return the file of a shot's notes, to be published with it; empty bytes where there are none."""
        return b""

    def unneeded(self, root: Path, requests: Iterable[RenderRequest]) -> tuple[str, Sequence[Path]]:
        """Return files outside of the store that nothing needs, for `clean` to delete.

        requests  of all shots of the root, at the qualities that were begun

        Returns a word for them, in the plural, and the files.
        """
        return "", ()

    def version_of(self, root: Path, shot: str, frames: Mapping[int, Key]) -> str:
        """Return the last published version of a shot with these frames, by their keys; empty for none."""
        return ""

    def published_files(self, store: Store) -> Iterable[PublishedFile]:
        """Yield the files of all published versions under a root, for `verify` to check."""
        return ()

    def remedies(self, faulty: Sequence[PublishedFile], root: Path) -> Iterable[str]:
        """Yield a line for each version among faulty files that says how to make its files again."""
        return ()

    def schemas(self) -> Mapping[str, type[BaseModel]]:
        """Return models of further kinds of files by the names of the kinds, for `flowsculpt schema KIND`."""
        return {}


def shot_extras() -> dict[str, ShotExtras]:
    """Return what each plug-in has, by the plug-in's name."""
    return plugins().objects("extras", ShotExtras)

"""The contract of plug-ins for what they have of a shot besides its frames: the door `extras`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from flowsculpt.pipeline.plugin import plugins

if TYPE_CHECKING:  # `clean` and `schema` need none of them, and importing them takes time
    from pydantic import BaseModel

    from flowsculpt.pipeline.production.picture_sequences import PictureSequence, SequenceGrid, SequenceQuery
    from flowsculpt.pipeline.production.request.render_request import RenderRequest
    from flowsculpt.pipeline.production.store.store import Store


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
class PublishedVersion:
    """A version of a shot, frozen in a folder that nothing overwrites.

    name    such as v001
    record  the file in the folder that says what the version was made from
    frames  files by frame number
    keys    of the finished frames by frame number
    files   SHA-256 by file: of the frames, the movie and the notes
    notes   the file of notes; None without
    fault   why the record cannot be read, and so no files are known; empty if it can
    """

    shot: str
    name: str
    record: Path
    frames: Mapping[int, Path] = field(default_factory=dict)
    keys: Mapping[int, str] = field(default_factory=dict)
    files: Mapping[Path, str] = field(default_factory=dict)
    notes: Path | None = None
    fault: str = ""


class ShotExtras:
    """What a plug-in has of a shot besides its frames. Its class overrides what it has; the rest is empty.

    An object of the class is made without arguments, once in a process. Other plug-ins ask all of them:
    `review` shows sequences and animations, `preview` prints warnings, `publish` freezes notes, `verify`
    checks versions, `clean` deletes what is unneeded. Keep the module of the class small and import in its
    methods: each of these commands imports it.
    """

    @staticmethod
    def of_plugins() -> dict[str, ShotExtras]:
        """Return what each plug-in has, by the plug-in's name."""
        return plugins().objects("extras", ShotExtras)

    def sequences(self, query: SequenceQuery) -> Iterable[PictureSequence | SequenceGrid]:
        """Yield picture sequences of the shot of a query, and grids of them, for the review page."""
        return ()

    def animation(self, request: RenderRequest, store: Store, most_vertices: int) -> Animation | None:
        """Return the frames of a request as an animation; None where the plug-in makes none.

        most_vertices  of each subject

        Raises FlowsculptError where the shot has none; its message says why.
        """
        return None

    def warnings(self, request: RenderRequest, last: int) -> Iterable[str]:
        """Yield lines about what the frames up to `last` will cost, before they are simulated."""
        return ()

    def notes(self, root: Path, shot: str) -> bytes:
        """Return the file of a shot's notes, to be published with it; empty bytes where there are none."""
        return b""

    def versions(self, root: Path, shot: str | None = None) -> Iterable[PublishedVersion]:
        """Yield the published versions of a shot, or of all shots, the oldest first."""
        return ()

    def unneeded(self, root: Path, requests: Iterable[RenderRequest]) -> tuple[str, Sequence[Path]]:
        """Return files outside of the store that nothing needs, for `clean` to delete.

        requests  of all shots of the root, at the qualities that were begun

        Returns a word for them, in the plural, and the files.
        """
        return "", ()

    def schemas(self) -> Mapping[str, type[BaseModel]]:
        """Return models of further kinds of files by the names of the kinds, for `flowsculpt schema KIND`."""
        return {}

"""The material of a review page: all sequences of a shot."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.errors import MissingInputError
from pipeline.plugin import plugins
from pipeline.production.execution.project import Project
from pipeline.production.picture_sequences import PictureSequence, SequenceGrid, SequenceQuery
from pipeline.production.request.lookup import find_shot
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.history import History
from render.scene.render_quality import DEFAULT_QUALITY

KINDS = ("render", "relit", "version", "wedge")
"""Kinds of sequences in their order on the page; others follow."""


@dataclass(frozen=True)
class ShotMaterial:
    """All material of a shot that a page shows."""

    request: RenderRequest
    sequences: tuple[PictureSequence, ...]
    wedges: tuple[SequenceGrid, ...]


@dataclass(frozen=True)
class Search:
    """Finds material in a project, at these qualities; at all qualities if there are none."""

    project: Project
    qualities: tuple[str, ...]
    history: History

    def shot(self, name: str) -> ShotMaterial:
        """Return the material of a shot. Raises MissingInputError if nothing is rendered, or ShotError."""
        path = find_shot(name)
        query = SequenceQuery(self.project, path, self.qualities, self.history)
        found: list[PictureSequence | SequenceGrid] = [
            query.rendered(request, "render", request.quality_name) for request in query.requests()
        ]
        found += [each for function in plugins().sequences for each in function(query)]
        grids = tuple(each for each in found if isinstance(each, SequenceGrid))
        single = [each for each in found if isinstance(each, PictureSequence)]
        cells = [sequence for grid in grids for sequence in grid.sequences]
        sequences = tuple(sorted((each for each in (*single, *cells) if each.files), key=_order))
        if not sequences:
            quality = self.qualities[0] if self.qualities else DEFAULT_QUALITY
            at = f" at {', '.join(self.qualities)}" if self.qualities else ""
            raise MissingInputError(
                f"{path.stem} has no rendered frames{at} for a review page; flowsculpt render "
                f"{path.stem} -q {quality} makes them"
            )
        return ShotMaterial(self.project.request(path, DEFAULT_QUALITY, variant="none"), sequences, grids)


def _order(sequence: PictureSequence) -> int:
    return KINDS.index(sequence.kind) if sequence.kind in KINDS else len(KINDS)

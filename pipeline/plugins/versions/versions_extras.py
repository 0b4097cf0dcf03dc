"""Shows published versions on the review page, and has them verified."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flowsculpt.api import ShotExtras

if TYPE_CHECKING:
    from pathlib import Path

    from flowsculpt.api.frames import PictureSequence, PublishedVersion, SequenceQuery


class VersionsExtras(ShotExtras):
    """The published versions of a shot."""

    def sequences(self, query: SequenceQuery) -> Iterator[PictureSequence]:
        from flowsculpt.pipeline.plugins.versions.publishing import published_sequences

        return published_sequences(query)

    def versions(self, root: Path, shot: str | None = None) -> Iterator[PublishedVersion]:
        from flowsculpt.pipeline.plugins.versions.provenance import published_versions

        return published_versions(root, shot)

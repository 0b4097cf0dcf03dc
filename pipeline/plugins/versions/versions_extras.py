"""Published versions of shots, for the review page, deliverables and `verify`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from flowsculpt.pipeline.production.shot_extras import PublishedFile, ShotExtras

if TYPE_CHECKING:
    from flowsculpt.api.frames import Key, PictureSequence, SequenceQuery, Store


class VersionsExtras(ShotExtras):
    """The published versions of a shot."""

    def sequences(self, query: SequenceQuery) -> Iterator[PictureSequence]:
        from flowsculpt.pipeline.plugins.versions.publishing import published_sequences

        return published_sequences(query)

    def version_of(self, root: Path, shot: str, frames: Mapping[int, Key]) -> str:
        """Return the last version of a shot with these frames."""
        from flowsculpt.pipeline.plugins.versions.provenance import version_of

        return version_of(root, shot, frames)

    def published_files(self, store: Store) -> Iterator[PublishedFile]:
        """Yield the files of all versions."""
        from flowsculpt.pipeline.plugins.versions.provenance import published_files

        return published_files(store)

    def remedies(self, faulty: Sequence[PublishedFile], root: Path) -> Iterator[str]:
        """Yield how to make each version among faulty files again."""
        from flowsculpt.pipeline.plugins.versions.provenance import remedies

        return remedies(faulty, root)

"""Shows wedges on the review page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flowsculpt.api import ShotExtras

if TYPE_CHECKING:
    from flowsculpt.api.frames import SequenceGrid, SequenceQuery


class SheetsExtras(ShotExtras):
    """The wedges of a shot."""

    def sequences(self, query: SequenceQuery) -> Iterator[SequenceGrid]:
        from flowsculpt.pipeline.plugins.sheets.wedge import wedge_sequences

        return wedge_sequences(query)

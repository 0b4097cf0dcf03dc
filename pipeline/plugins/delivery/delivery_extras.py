"""Shows relit frames on the review page."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from flowsculpt.api import ShotExtras

if TYPE_CHECKING:
    from flowsculpt.api.frames import PictureSequence, SequenceQuery


class DeliveryExtras(ShotExtras):
    """The relit versions of a shot."""

    def sequences(self, query: SequenceQuery) -> Iterator[PictureSequence]:
        from flowsculpt.pipeline.plugins.delivery.relighting import relit_sequences

        return relit_sequences(query)

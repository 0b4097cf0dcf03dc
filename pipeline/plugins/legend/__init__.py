"""Legends over finished pictures: what colours stand for, the date of the data, and a scale."""

from flowsculpt.api import PictureStage, Plugin, ShotEntry

_DOCUMENTS = "flowsculpt.pipeline.plugins.legend.legend_documents"
_PARTS = "flowsculpt.pipeline.plugins.legend.legend_parts"

PLUGIN = Plugin(
    name="legend",
    version="1",
    entries={
        name: ShotEntry(
            f"{_DOCUMENTS}:{document}",
            PictureStage(f"{_PARTS}:draw_{name}", version=version, doing="drawing legends", is_last=True),
        )
        for name, document, version in (
            ("colours", "ColoursDocument", 2),
            ("clock", "ClockDocument", 3),
            ("scale", "ScaleBarDocument", 3),
        )
    },
)

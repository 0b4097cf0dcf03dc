"""The flow `move`: carries a subject along keys, its far parts later than the near ones."""

from flowsculpt.api import Plugin

PLUGIN = Plugin(
    name="moves",
    version="2",
    flows={"move": "flowsculpt.pipeline.plugins.moves.move_document:MoveDocument"},
)

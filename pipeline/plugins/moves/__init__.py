"""The flow `move`, which carries a subject along keys, and `lag`, by which far parts follow flows later."""

from flowsculpt.api import Plugin

PLUGIN = Plugin(
    name="moves",
    version="3",
    flows={
        "move": "flowsculpt.pipeline.plugins.moves.late_documents:MoveDocument",
        "lag": "flowsculpt.pipeline.plugins.moves.late_documents:LagDocument",
    },
)
"""The entries `move` and `lag` of flows in a shot file."""

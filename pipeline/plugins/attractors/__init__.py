"""The flows of strange attractors besides `lorenz`."""

from flowsculpt.api import Plugin

_FLOWS = "flowsculpt.pipeline.plugins.attractors.attractor_flows"

PLUGIN = Plugin(
    name="attractors",
    version="1",
    flows={
        "rossler": f"{_FLOWS}:Rossler",
        "aizawa": f"{_FLOWS}:Aizawa",
        "thomas": f"{_FLOWS}:Thomas",
        "chua": f"{_FLOWS}:Chua",
        "halvorsen": f"{_FLOWS}:Halvorsen",
        "chen": f"{_FLOWS}:Chen",
    },
)

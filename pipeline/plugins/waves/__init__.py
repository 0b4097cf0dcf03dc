"""The flows of crossed waves: `taylor_green` and `kneading`."""

from flowsculpt.api import Plugin

_FLOWS = "flowsculpt.pipeline.plugins.waves.wave_flows"

PLUGIN = Plugin(
    name="waves",
    version="1",
    flows={"taylor_green": f"{_FLOWS}:TaylorGreen", "kneading": f"{_FLOWS}:Kneading"},
)

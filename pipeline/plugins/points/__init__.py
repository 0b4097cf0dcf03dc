"""Points as subjects: clouds, drawn as spheres, and control nets of smooth surfaces."""

from flowsculpt.api import Plugin

PLUGIN = Plugin(
    name="points",
    version="1",
    subjects={
        "cloud": "flowsculpt.pipeline.plugins.points.point_documents:CloudDocument",
        "net": "flowsculpt.pipeline.plugins.points.point_documents:NetDocument",
    },
)

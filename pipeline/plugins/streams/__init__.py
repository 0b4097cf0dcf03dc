"""What velocities draw out of curves of seeds: stream, path and streak surfaces and lines, as subjects."""

from flowsculpt.api import Plugin

_DOCUMENTS = "flowsculpt.pipeline.plugins.streams.stream_documents"

PLUGIN = Plugin(
    name="streams",
    version="1",
    subjects={
        "stream_surface": f"{_DOCUMENTS}:StreamSurfaceDocument",
        "path_surface": f"{_DOCUMENTS}:PathSurfaceDocument",
        "streak_surface": f"{_DOCUMENTS}:StreakSurfaceDocument",
        "stream_lines": f"{_DOCUMENTS}:StreamLinesDocument",
        "path_lines": f"{_DOCUMENTS}:PathLinesDocument",
        "streak_lines": f"{_DOCUMENTS}:StreakLinesDocument",
    },
)

"""Previews by a rasteriser, first pictures of a run, the live page, performances, shots in other programs."""

from flowsculpt.api import Command, Plugin

PLUGIN = Plugin(
    name="preview",
    version="1",
    commands={
        "preview": Command(
            "flowsculpt.pipeline.plugins.preview.preview_command:preview",
            "Draw a shot in seconds, without a path tracer, or live while you edit.",
            "Look",
            also="play view show",
            opening="`flowsculpt preview A010_first` draws a shot in seconds.",
        ),
        "edit": Command(
            "flowsculpt.pipeline.plugins.preview.program_commands:edit",
            "Edit values of a shot file, for programs: JSON in, JSON out.",
            "Write shots",
        ),
        "frames": Command(
            "flowsculpt.pipeline.plugins.preview.program_commands:frames",
            "List the files and cameras of a shot's frames, for programs.",
            "Look",
        ),
    },
    extras="flowsculpt.pipeline.plugins.preview.preview_extras:PreviewExtras",
    observer="flowsculpt.pipeline.plugins.preview.first_look:FirstLook",
)

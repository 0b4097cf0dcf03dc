"""Lettering: words and drawings as subjects, extruded and bevelled, and shots with a subject a letter."""

from flowsculpt.api import Command, Plugin

PLUGIN = Plugin(
    name="lettering",
    version="1",
    subjects={
        "text": "flowsculpt.pipeline.plugins.lettering.kinds:TextKind",
        "svg": "flowsculpt.pipeline.plugins.lettering.kinds:SvgKind",
        "start": "flowsculpt.pipeline.plugins.lettering.kinds:StartKind",
    },
    commands={
        "letters": Command(
            "flowsculpt.pipeline.plugins.lettering.letters_command:letters",
            "Begin a shot of a word, with a subject a letter.",
            "Write shots",
        )
    },
)

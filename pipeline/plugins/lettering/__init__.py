"""Lettering: words and drawings as subjects, extruded and bevelled, and shots with a subject a letter."""

from pipeline.plugin import Command, Plugin

PLUGIN = Plugin(
    name="lettering",
    version="1",
    subjects={
        "text": "pipeline.plugins.lettering.kinds:TextKind",
        "svg": "pipeline.plugins.lettering.kinds:SvgKind",
        "start": "pipeline.plugins.lettering.kinds:StartKind",
    },
    commands={
        "letters": Command(
            "pipeline.plugins.lettering.letters_command:letters",
            "Begin a shot of a word, with a subject a letter.",
            "Write shots",
        )
    },
)

"""Deliverables: frames encoded for others, relit frames, and timelines of editing programs."""

from flowsculpt.api import Command, FileFormat, Plugin

PLUGIN = Plugin(
    name="delivery",
    version="1",
    commands={
        "deliver": Command(
            "flowsculpt.pipeline.plugins.delivery.deliver_command:deliver",
            "Encode shots and films for review, editing, archive or web.",
            "Deliver",
        ),
        "relight": Command(
            "flowsculpt.pipeline.plugins.delivery.relighting:relight",
            "Change lights of finished frames by factors, without rendering.",
            "Render",
        ),
        "export otio": Command(
            "flowsculpt.pipeline.plugins.delivery.timeline:otio", "OpenTimelineIO, for editing programs."
        ),
    },
    formats={"otio": FileFormat(edit="flowsculpt.pipeline.plugins.delivery.timeline_import:edit_of")},
    extras="flowsculpt.pipeline.plugins.delivery.delivery_extras:DeliveryExtras",
)

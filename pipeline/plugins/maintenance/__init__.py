"""The state of a root: what is done, why a frame is not, what is damaged, and what nothing needs."""

from flowsculpt.api import Command, Plugin

PLUGIN = Plugin(
    name="maintenance",
    version="1",
    commands={
        "status": Command(
            "flowsculpt.pipeline.plugins.maintenance.status_commands:status",
            "List which frames are done, stale and missing.",
            "Maintain",
            also="list ls",
        ),
        "why": Command(
            "flowsculpt.pipeline.plugins.maintenance.status_commands:why",
            "Explain why a frame would be rendered again.",
            "Maintain",
            also="explain",
        ),
        "report": Command(
            "flowsculpt.pipeline.plugins.maintenance.status_commands:report",
            "Show where the time of a run went.",
            "Maintain",
        ),
        "verify": Command(
            "flowsculpt.pipeline.plugins.maintenance.store_commands:verify",
            "Check every stored file and make damaged ones again.",
            "Maintain",
        ),
        "audit": Command(
            "flowsculpt.pipeline.plugins.maintenance.audit_command:audit",
            "Make random finished frames again, and compare their bits.",
            "Maintain",
        ),
        "clean": Command(
            "flowsculpt.pipeline.plugins.maintenance.store_commands:clean",
            "Delete stored files that nothing needs.",
            "Maintain",
            also="delete remove",
        ),
    },
    observer="flowsculpt.pipeline.plugins.maintenance.run_report:RunSummary",
)

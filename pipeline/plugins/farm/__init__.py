"""Farms: jobs for render managers and Kubernetes, and the tasks that they run."""

from pipeline.plugin import Command, Plugin

PLUGIN = Plugin(
    name="farm",
    version="1",
    commands={
        "task": Command(
            "pipeline.plugins.farm.farm_commands:task",
            "Run part of a shot's plan, as a worker of a render manager.",
            "Render",
        ),
    },
    exporters={
        "openjd": Command(
            "pipeline.plugins.farm.farm_commands:openjd", "Open Job Description, for render managers."
        ),
        "plan": Command("pipeline.plugins.farm.farm_commands:plan", "What tasks of a render manager read."),
        "kubernetes": Command("pipeline.plugins.farm.farm_commands:kubernetes", "Manifests of Jobs."),
    },
)

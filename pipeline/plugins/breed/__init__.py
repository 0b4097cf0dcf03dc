"""Breeding: children of one shot or two, made by chance, from which a person chooses."""

from pipeline.plugin import Command, Plugin

PLUGIN = Plugin(
    name="breed",
    version="1",
    commands={
        "breed": Command(
            "pipeline.plugins.breed.breed_command:breed",
            "Make twelve children of a shot, or of two, to choose from.",
            "Write shots",
        )
    },
    unneeded=("pipeline.plugins.breed.generation:unneeded_trials",),
    documents={"ancestry": "pipeline.plugins.breed.ancestry:AncestryDocument"},
)

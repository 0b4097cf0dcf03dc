"""Breeding: children of one shot or two, made by chance, from which a person chooses."""

from flowsculpt.api import Command, Plugin, ShotEntry

PLUGIN = Plugin(
    name="breed",
    version="1",
    commands={
        "breed": Command(
            "flowsculpt.pipeline.plugins.breed.breed_command:breed",
            "Make twelve children of a shot, or of two, to choose from.",
            "Write shots",
        )
    },
    extras="flowsculpt.pipeline.plugins.breed.breed_extras:BreedExtras",
    entries={"ancestry": ShotEntry("flowsculpt.pipeline.plugins.breed.ancestry:AncestryDocument")},
)

"""Interchange: models of other 3-D programs, and shots and resampled models as files for them."""

from pipeline.plugin import Command, Plugin

PLUGIN = Plugin(
    name="interchange",
    version="1",
    commands={
        "resample": Command(
            "pipeline.plugins.interchange.resample_command:resample", "Resample one mesh file.", "Maintain"
        ),
    },
    exporters={
        "usd": Command(
            "pipeline.plugins.interchange.export_commands:usd",
            "The sculpture with its motion, camera and lights, for 3-D programs.",
        ),
        "ply": Command("pipeline.plugins.interchange.export_commands:ply", "A mesh file of each frame."),
        "obj": Command("pipeline.plugins.interchange.export_commands:obj", "A mesh file of each frame."),
        "glb": Command(
            "pipeline.plugins.interchange.export_commands:glb", "A mesh file of one frame, for the web."
        ),
        "stl": Command(
            "pipeline.plugins.interchange.export_commands:stl", "A mesh file of one frame, to be printed."
        ),
    },
    mesh_formats={
        "off": "pipeline.plugins.interchange.off_files:OFF",
        "glb": "pipeline.plugins.interchange.model_formats:GLTF",
        "gltf": "pipeline.plugins.interchange.model_formats:GLTF",
        "fbx": "pipeline.plugins.interchange.model_formats:FBX",
        "dae": "pipeline.plugins.interchange.model_formats:COLLADA",
        "3mf": "pipeline.plugins.interchange.model_formats:THREEMF",
        "usd": "pipeline.plugins.interchange.model_formats:USD",
        "usda": "pipeline.plugins.interchange.model_formats:USD",
        "usdc": "pipeline.plugins.interchange.model_formats:USD",
        "usdz": "pipeline.plugins.interchange.model_formats:USD",
    },
)

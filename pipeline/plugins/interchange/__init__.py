"""Interchange: models of other 3-D programs, and shots and resampled models as files for them."""

from flowsculpt.api import Command, Plugin

_COMMANDS = "flowsculpt.pipeline.plugins.interchange.export_commands"
_ANIMATIONS = "flowsculpt.pipeline.plugins.interchange.animation_commands"

PLUGIN = Plugin(
    name="interchange",
    version="1",
    commands={
        "resample": Command(
            "flowsculpt.pipeline.plugins.interchange.resample_command:resample",
            "Resample one mesh file.",
            "Maintain",
        ),
        "export usd": Command(
            f"{_COMMANDS}:usd", "The sculpture with its motion, camera and lights, for 3-D programs."
        ),
        "export ply": Command(f"{_COMMANDS}:ply", "A mesh file of each frame."),
        "export obj": Command(f"{_COMMANDS}:obj", "A mesh file of each frame."),
        "export glb": Command(f"{_COMMANDS}:glb", "A mesh file of one frame, for the web."),
        "export stl": Command(f"{_COMMANDS}:stl", "A mesh file of one frame, to be printed."),
        "export gltf": Command(
            f"{_ANIMATIONS}:gltf", "One mesh that moves, for pages, viewers and DCC programs."
        ),
        "export abc": Command(f"{_ANIMATIONS}:abc", "One mesh that moves, as Alembic, for DCC programs."),
        "export vat": Command(f"{_ANIMATIONS}:vat", "One mesh that moves, as textures for game engines."),
        "export web": Command(f"{_ANIMATIONS}:web", "A page that plays the sculpture."),
    },
    mesh_formats={
        "obj": "flowsculpt.pipeline.plugins.interchange.obj_files:OBJ",
        "stl": "flowsculpt.pipeline.plugins.interchange.stl_files:STL",
        "off": "flowsculpt.pipeline.plugins.interchange.off_files:OFF",
        "glb": "flowsculpt.pipeline.plugins.interchange.gltf_files:GLTF",
        "gltf": "flowsculpt.pipeline.plugins.interchange.gltf_files:GLTF",
        "fbx": "flowsculpt.pipeline.plugins.interchange.fbx_files:FBX",
        "dae": "flowsculpt.pipeline.plugins.interchange.collada_files:COLLADA",
        "3mf": "flowsculpt.pipeline.plugins.interchange.threemf_files:THREEMF",
        **dict.fromkeys(
            ("usd", "usda", "usdc", "usdz"), "flowsculpt.pipeline.plugins.interchange.usd_files:USD"
        ),
    },
    extras="flowsculpt.pipeline.plugins.interchange.interchange_extras:InterchangeExtras",
    paints={
        "obj": "flowsculpt.pipeline.plugins.interchange.obj_paint:OBJ_PAINT",
        **dict.fromkeys(("glb", "gltf"), "flowsculpt.pipeline.plugins.interchange.gltf_paint:GLTF_PAINT"),
        "fbx": "flowsculpt.pipeline.plugins.interchange.fbx_paint:FBX_PAINT",
        **dict.fromkeys(
            ("usd", "usda", "usdc", "usdz"), "flowsculpt.pipeline.plugins.interchange.usd_files:USD_PAINT"
        ),
    },
)

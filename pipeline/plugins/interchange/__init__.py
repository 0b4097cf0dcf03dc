"""Interchange: models of other 3-D programs, and shots and resampled models as files for them."""

from flowsculpt.api import Command, FileFormat, Plugin

_HERE = "flowsculpt.pipeline.plugins.interchange"
_COMMANDS = f"{_HERE}.export_commands"
_ANIMATIONS = f"{_HERE}.animation_commands"

PLUGIN = Plugin(
    name="interchange",
    version="1",
    commands={
        "resample": Command(
            f"{_HERE}.resample_command:resample",
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
    formats={
        "obj": FileFormat(f"{_HERE}.obj_files:OBJ", f"{_HERE}.obj_paint:OBJ_PAINT"),
        "ply": FileFormat(f"{_HERE}.ply_files:PLY"),
        "stl": FileFormat(f"{_HERE}.stl_files:STL"),
        "off": FileFormat(f"{_HERE}.off_files:OFF"),
        **dict.fromkeys(
            ("glb", "gltf"),
            FileFormat(
                f"{_HERE}.gltf_files:GLTF",
                f"{_HERE}.gltf_paint:GLTF_PAINT",
                motion=f"{_HERE}.gltf_motion:open_gltf",
            ),
        ),
        "fbx": FileFormat(
            f"{_HERE}.fbx_files:FBX", f"{_HERE}.fbx_paint:FBX_PAINT", motion=f"{_HERE}.fbx_motion:open_fbx"
        ),
        "abc": FileFormat(f"{_HERE}.alembic_files:ALEMBIC", motion=f"{_HERE}.alembic_files:open_alembic"),
        "pc2": FileFormat(motion=f"{_HERE}.point_caches:open_pc2"),
        "mdd": FileFormat(motion=f"{_HERE}.point_caches:open_mdd"),
        "dae": FileFormat(f"{_HERE}.collada_files:COLLADA"),
        "3mf": FileFormat(f"{_HERE}.threemf_files:THREEMF"),
        **dict.fromkeys(
            ("usd", "usda", "usdc", "usdz"),
            FileFormat(
                f"{_HERE}.usd_files:USD",
                f"{_HERE}.usd_files:USD_PAINT",
                motion=f"{_HERE}.usd_motion:open_usd",
            ),
        ),
    },
    extras=f"{_HERE}.interchange_extras:InterchangeExtras",
)

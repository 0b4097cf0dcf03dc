"""From arrays to pictures and films. Knows no shot and no flow, and never imports `pipeline`.

The public names, each imported from its module when first used:

    from flowsculpt.render import LIGHTS, LOOKS, QUALITIES, Scene, Surface, choose, denoise, render_frame
"""

from importlib import import_module
from typing import Any

from flowsculpt.render.base.python_process import is_own, prepare

if is_own():
    prepare()

_MODULES = {
    "flowsculpt.render.base.render_errors": (
        "BadInputError",
        "CorruptImageError",
        "FlowsculptError",
        "MissingImageError",
    ),
    "flowsculpt.render.base.serialise": ("from_plain", "to_plain"),
    "flowsculpt.render.scene.aovs": ("AOVS", "RenderedFrame"),
    "flowsculpt.render.scene.render_camera": ("Camera",),
    "flowsculpt.render.scene.scene_lights": ("LIGHTS", "LightRig", "Sky", "Softbox", "Sun"),
    "flowsculpt.render.scene.materials": ("LOOKS", "Material"),
    "flowsculpt.render.scene.render_quality": ("QUALITIES", "Quality"),
    "flowsculpt.render.scene.scene": ("MotionSample", "Scene"),
    "flowsculpt.render.scene.scene_stage": ("STAGES", "Stage", "StagePlacement"),
    "flowsculpt.render.scene.surface": ("Spheres", "Surface"),
    "flowsculpt.render.mitsuba.engine": ("Engine", "choose"),
    "flowsculpt.render.frame.render_frame": ("ShutterInterval", "render_frame"),
    "flowsculpt.render.frame.batch_schedule": ("seed_of",),
    "flowsculpt.render.post.colour": ("quantise", "to_display"),
    "flowsculpt.render.post.denoise": ("denoise",),
    "flowsculpt.render.post.image": ("read_exr", "write_exr", "write_png"),
    "flowsculpt.render.movie.encode": ("write_movie",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)

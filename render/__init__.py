"""From arrays to pictures and films. Knows no shot and no flow, and never imports `pipeline`.

The public names, each imported from its module when first used:

    from render import LIGHTS, LOOKS, QUALITIES, STAGES, Scene, Surface, choose, denoise, render_frame
"""

from importlib import import_module
from typing import Any

from render.base.python_process import (
    forget_unreadable_settings,
    import_numba_elsewhere,
    prefer_installed_packages,
)

prefer_installed_packages()
forget_unreadable_settings()
import_numba_elsewhere()

_MODULES = {
    "render.base.render_errors": (
        "BadInputError",
        "CorruptImageError",
        "FlowsculptError",
        "MissingImageError",
    ),
    "render.base.serialise": ("from_plain", "to_plain"),
    "render.scene.aovs": ("AOVS", "RenderedFrame"),
    "render.scene.render_camera": ("Camera",),
    "render.scene.scene_lights": ("LIGHTS", "LightRig", "Sky", "Softbox", "Sun"),
    "render.scene.materials": ("LOOKS", "Material"),
    "render.scene.render_quality": ("QUALITIES", "Quality"),
    "render.scene.scene": ("MotionSample", "Scene"),
    "render.scene.scene_stage": ("STAGES", "Stage", "StagePlacement"),
    "render.scene.surface": ("Spheres", "Surface"),
    "render.mitsuba.engine": ("Engine", "choose"),
    "render.frame.render_frame": ("ShutterInterval", "render_frame"),
    "render.frame.batch_schedule": ("seed_of",),
    "render.post.colour": ("quantise", "to_display"),
    "render.post.denoise": ("denoise",),
    "render.post.image": ("read_exr", "write_exr", "write_png"),
    "render.movie.encode": ("write_movie",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}

__all__ = sorted(_MODULE_OF)


def __getattr__(name: str) -> Any:
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'render' has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)

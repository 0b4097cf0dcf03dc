"""Shots: the contents of a shot file as values, and how they are read.

Names are imported on first use: reading shots takes half a second of imports, which many users of this
package do not need.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.shot.camera import CameraPath
    from pipeline.shot.clock import Clock
    from pipeline.shot.film_reader import read_film
    from pipeline.shot.motion import Motion, Resampling
    from pipeline.shot.shot import Film, Picture, Shot
    from pipeline.shot.shot_reader import read_shot
    from pipeline.shot.subject import Model, Solid, Subject

__all__ = [
    "CameraPath",
    "Clock",
    "Film",
    "Model",
    "Motion",
    "Picture",
    "Resampling",
    "Shot",
    "Solid",
    "Subject",
    "read_film",
    "read_shot",
]

_MODULES = {
    "camera": ("CameraPath",),
    "clock": ("Clock",),
    "film_reader": ("read_film",),
    "motion": ("Motion", "Resampling"),
    "shot": ("Film", "Picture", "Shot"),
    "shot_reader": ("read_shot",),
    "subject": ("Model", "Solid", "Subject"),
}


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

"""Shots: what a shot file says, as values.

What is asked for is imported then: reading shots takes more than half a second to get ready for, and much of
what has to do with shots reads none.
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
    "CameraPath": "camera",
    "Clock": "clock",
    "Film": "shot",
    "Model": "subject",
    "Motion": "motion",
    "Picture": "shot",
    "Resampling": "motion",
    "Shot": "shot",
    "Solid": "subject",
    "Subject": "subject",
    "read_film": "film_reader",
    "read_shot": "shot_reader",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)

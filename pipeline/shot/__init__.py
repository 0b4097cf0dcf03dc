"""Shots: what a shot file says, as values.

What is asked for is imported then: reading shots takes more than half a second to get ready for, and much of
what has to do with shots reads none.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pipeline.shot.cameras import CameraPath
    from pipeline.shot.clock import Clock
    from pipeline.shot.film import read_film
    from pipeline.shot.motion import Motion, Resampling
    from pipeline.shot.read import read_shot
    from pipeline.shot.shot import Film, Picture, Shot
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

_PLACES = {
    "CameraPath": "cameras",
    "Clock": "clock",
    "Film": "shot",
    "Model": "subject",
    "Motion": "motion",
    "Picture": "shot",
    "Resampling": "motion",
    "Shot": "shot",
    "Solid": "subject",
    "Subject": "subject",
    "read_film": "film",
    "read_shot": "read",
}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)

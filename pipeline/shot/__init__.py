"""Shots: the contents of a shot file as values, and how they are read.

Names are imported on first use: reading shots takes half a second of imports, which many users of this
package do not need.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from flowsculpt.pipeline.shot.camera_path import CameraPath as CameraPath
    from flowsculpt.pipeline.shot.film_reader import read_film as read_film
    from flowsculpt.pipeline.shot.motion import Clock as Clock
    from flowsculpt.pipeline.shot.motion import Motion as Motion
    from flowsculpt.pipeline.shot.motion import Resampling as Resampling
    from flowsculpt.pipeline.shot.shot import Film as Film
    from flowsculpt.pipeline.shot.shot import Picture as Picture
    from flowsculpt.pipeline.shot.shot import Shot as Shot
    from flowsculpt.pipeline.shot.shot_reader import read_shot as read_shot
    from flowsculpt.pipeline.shot.subjects import Model as Model
    from flowsculpt.pipeline.shot.subjects import Solid as Solid
    from flowsculpt.pipeline.shot.subjects import Subject as Subject

_MODULES = {
    "camera_path": ("CameraPath",),
    "film_reader": ("read_film",),
    "motion": ("Clock", "Motion", "Resampling"),
    "shot": ("Film", "Picture", "Shot"),
    "shot_reader": ("read_shot",),
    "subjects": ("Model", "Solid", "Subject"),
}


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

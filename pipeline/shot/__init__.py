"""Shots: what a shot file says, as values."""

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

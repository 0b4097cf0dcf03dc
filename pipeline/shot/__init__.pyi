"""Shots; `__init__.py` imports each name from its module when it is first used."""

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

"""Shot = motion + picture, and the film they are cut into.

Meshes depend on the motion alone, pictures on both: relighting never moves a vertex again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.frames import FrameRange, FrameRate
from pipeline.shot.camera import CameraPath
from pipeline.shot.data import NOT_DATA
from pipeline.shot.motion import Motion
from pipeline.shot.shutter import PictureLayers, Shutter
from render.post.view import ACES, ColourView
from render.scene.lights import LightRig
from render.scene.look import Look
from render.scene.quality import QUALITIES, Quality
from render.scene.stage import Stage


@dataclass(frozen=True)
class Picture:
    """All that decides how the meshes of a shot look.

    view        how its light is shown
    tessellate  into how many pieces every edge is cut, on curved patches over the triangles (P37); 1: not
    dicing      how many pixels a piece of an edge spans at most, instead; None: as many pieces as said
    qualities   those of `render.scene.quality.QUALITIES`, as this shot needs them
    layers      what comes with the beauty beyond what the denoiser needs
    """

    look: Look
    camera: CameraPath
    lights: LightRig
    stage: Stage
    view: ColourView = ACES
    tessellate: int = 1
    dicing: float | None = None
    qualities: Mapping[str, Quality] = field(default_factory=lambda: QUALITIES)
    shutter: Shutter = field(default_factory=Shutter)
    layers: PictureLayers = field(default_factory=PictureLayers)

    def shown_as(self) -> dict[str, Any]:
        """Plain data of what is between its light and the pictures of a display."""
        return {"exposure": self.lights.exposure, "view": self.view.recipe}


@dataclass(frozen=True)
class Shot:
    """One shot of a film. `name` is the file's, without its ending.

    files  those that it was made of beside shot files, and the SHA-256 of their contents
    """

    name: str
    title: str
    motion: Motion
    picture: Picture
    intent: str = ""
    path: Path | None = field(default=None, metadata=NOT_DATA)
    files: tuple[tuple[Path, str], ...] = field(default=(), metadata=NOT_DATA)

    @property
    def frames(self) -> FrameRange:
        return self.motion.frames

    @property
    def rate(self) -> FrameRate:
        return self.motion.rate


@dataclass(frozen=True)
class Clip:
    """A shot as an edit shows it: those of its frames, in that order.

    dissolve  over how many frames it comes through what is before it
    """

    shot: Shot
    frames: FrameRange
    dissolve: int = 0

    def length(self, rate: FrameRate) -> int:
        """Frames, at the film's rate, which is the shot's too."""
        return len(self.frames)


@dataclass(frozen=True)
class Card:
    """Words between shots; `dissolve` as of a clip."""

    title: str
    subtitle: str = ""
    seconds: float = 2.0
    dissolve: int = 0

    def length(self, rate: FrameRate) -> int:
        """Frames, the nearest to its seconds."""
        return round(self.seconds * float(rate.fps))


@dataclass(frozen=True)
class SoundTrack:
    """What is heard with a film.

    digest             SHA-256 of the file
    start              second of the film at which it begins; before 0, so much of its beginning is left out
    gain               decibels
    fade_in, fade_out  seconds
    """

    file: Path = field(metadata=NOT_DATA)
    digest: str
    start: float = 0.0
    gain: float = 0.0
    fade_in: float = 0.0
    fade_out: float = 0.0


@dataclass(frozen=True)
class Film:
    """The edit: clips of shots and cards in order, the words around them, and what is heard.

    title_seconds, credits_seconds  how long those cards stand; 0 leaves them out
    """

    title: str
    entries: tuple[Clip | Card, ...]
    rate: FrameRate
    subtitle: str = ""
    credits: tuple[str, ...] = ()
    title_seconds: float = 3.0
    credits_seconds: float = 3.0
    sound: SoundTrack | None = None
    path: Path | None = field(default=None, metadata=NOT_DATA)

    @property
    def clips(self) -> tuple[Clip, ...]:
        return tuple(entry for entry in self.entries if isinstance(entry, Clip))

    @property
    def shots(self) -> tuple[Shot, ...]:
        """Those of the clips, one each."""
        return tuple(clip.shot for clip in self.clips)

    @property
    def seconds(self) -> float:
        """How long the film is, cards included; what dissolves overlaps."""
        shown = self.rate.seconds(sum(e.length(self.rate) - e.dissolve for e in self.entries))
        return (
            shown + (self.title_seconds if self.title else 0) + (self.credits_seconds if self.credits else 0)
        )

"""Shot = motion + picture, and the film that shots are cut into.

Meshes depend on the motion alone, pictures on both: relighting never moves a vertex.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from flowsculpt.pipeline.errors import UsageError, quote, suggest
from flowsculpt.pipeline.flow.flow import foreign_flows
from flowsculpt.pipeline.frames import FrameRange, FrameRate
from flowsculpt.pipeline.shot.camera_path import CameraPath, Shutter
from flowsculpt.pipeline.shot.motion import Loop, Motion
from flowsculpt.render.base.serialise import NOT_PLAIN, OMIT_DEFAULT
from flowsculpt.render.graphics.title_card import PLAIN, CardStyle
from flowsculpt.render.post.picture_display import PictureDisplay
from flowsculpt.render.post.view import ACES, ColourView
from flowsculpt.render.scene.aovs import AOVS, EXTRA
from flowsculpt.render.scene.materials import Material
from flowsculpt.render.scene.render_camera import PERSPECTIVE
from flowsculpt.render.scene.render_quality import QUALITIES, Quality, flat_qualities
from flowsculpt.render.scene.rgb_spaces import WORKING_SPACES, WorkingSpace
from flowsculpt.render.scene.scene_lights import LightRig
from flowsculpt.render.scene.scene_stage import Stage


@dataclass(frozen=True)
class AovSelection:
    """The AOVs that a shot names, with their precision, half or float, in the order of `AOVS`."""

    precision: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(cls, written: Mapping[str, str] | list[str]) -> AovSelection:
        """Return the selection of names in their usual precision, or of a mapping of names to precisions."""
        usual = {name: AOVS[name].precision for name in written}
        precision = written if isinstance(written, Mapping) else usual
        return cls(tuple((name, precision[name]) for name in AOVS if name in precision))

    def adding(self, *names: str) -> AovSelection:
        """Return the selection with more AOVs, those in their usual precision."""
        return AovSelection.of({**{name: AOVS[name].precision for name in names}, **dict(self.precision)})

    @property
    def extra(self) -> tuple[str, ...]:
        """The names of the AOVs that a frame has only on request."""
        return tuple(name for name, _ in self.precision if name in EXTRA)


@dataclass(frozen=True)
class FrameOverride:
    """A look, lights and a quality of some frames, in place of their shot's.

    look, lights  None for the shot's
    qualities     settings by the names of qualities and of fields of `Quality`
    """

    frames: FrameRange
    look: Material | None = None
    lights: LightRig | None = None
    qualities: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @property
    def is_seen(self) -> bool:
        """True if the frames look otherwise than those beside them; quality alone changes their noise."""
        return self.look is not None or self.lights is not None


@dataclass(frozen=True)
class Picture:
    """All that decides how the meshes of a shot look.

    view        the colour view that shows its light, which is in the view's working space
    tessellate  segments that every edge is cut into, on curved patches over the triangles (P37); 1 is off
    dicing      longest segment of an edge in pixels, in place of `tessellate`; None is off
    hide_facets edges are cut as each picture needs, so that outlines show no corners
    qualities   `flowsculpt.render.scene.render_quality.QUALITIES` with the shot's own settings
    overrides   frames with a look, lights or quality of their own; no frame is in two
    aovs        the AOVs that the shot names
    layers      whose channel names the layers of finished frames have, one of `quality.CONVENTIONS`; None
                for frames that hold light and alpha alone
    """

    look: Material
    camera: CameraPath
    lights: LightRig
    stage: Stage
    view: ColourView = ACES
    tessellate: int = 1
    dicing: float | None = None
    hide_facets: bool = False
    qualities: Mapping[str, Quality] = field(default_factory=lambda: QUALITIES)
    shutter: Shutter = field(default_factory=Shutter)
    aovs: AovSelection = field(default_factory=AovSelection)
    layers: str | None = None
    overrides: tuple[FrameOverride, ...] = ()

    def overridden(self, override: FrameOverride) -> Picture:
        """Return the picture of the frames of an override; the exposure is the shot's."""
        lights = override.lights and replace(override.lights, exposure=self.lights.exposure)
        settings = override.qualities
        return replace(
            self,
            look=override.look or self.look,
            lights=lights or self.lights,
            qualities={
                name: replace(quality, **settings.get(name, {})) for name, quality in self.qualities.items()
            },
        )

    def in_perspective(self) -> Picture:
        """Return the picture in perspective, in the usual sizes; itself if its projection is not wide."""
        if not self.camera.projection.is_wide:
            return self
        camera = replace(self.camera, projection=PERSPECTIVE)
        return replace(self, camera=camera, qualities=flat_qualities(self.qualities))

    @property
    def working_space(self) -> WorkingSpace:
        """The space that light is computed in, and pictures are written in."""
        return WORKING_SPACES[self.view.working_space]

    @property
    def display(self) -> PictureDisplay:
        """The exposure and the view that map rendered light to display colours."""
        return PictureDisplay(self.lights.exposure, self.view)


@dataclass(frozen=True)
class SoundTrack:
    """A sound file under a shot or a film.

    digest             SHA-256 of the file
    start              second of the shot or film at which it begins; a negative start cuts its beginning
    gain               decibels
    fade_in, fade_out  seconds
    silence            seconds that timestamps in the file leave empty, before its sound and within
    """

    file: Path = field(metadata=NOT_PLAIN)
    digest: str
    start: float = 0.0
    gain: float = 0.0
    fade_in: float = 0.0
    fade_out: float = 0.0
    silence: float = field(default=0.0, metadata=OMIT_DEFAULT)


@dataclass(frozen=True)
class Shot:
    """One shot of a film. `name` is the file's, without its ending.

    files     the files that it was read from except shot files, and the SHA-256 of their contents
    sounds    what is heard while it plays
    notes     remarks on its sounds and on the materials of its models, for the user
    entries   what it writes for plug-ins, as their pydantic models, by names such as `marbling.mist`
    subject   the name of its subject, if it is one of several of a shot file
    subjects  the shot with each of its subjects alone, if it has several. Its own motion then has the flows
              that move all of them, and its look is that of the first
    """

    name: str
    title: str
    motion: Motion
    picture: Picture
    intent: str = ""
    path: Path | None = field(default=None, metadata=NOT_PLAIN)
    files: tuple[tuple[Path, str], ...] = field(default=(), metadata=NOT_PLAIN)
    sounds: tuple[SoundTrack, ...] = field(default=(), metadata=NOT_PLAIN)
    notes: tuple[str, ...] = field(default=(), metadata=NOT_PLAIN)
    entries: Mapping[str, Any] = field(default_factory=dict, metadata=NOT_PLAIN)
    subject: str = ""
    subjects: tuple[Shot, ...] = field(default=(), metadata=NOT_PLAIN)

    @property
    def parts(self) -> tuple[Shot, ...]:
        """The shots of one subject each: those of `subjects`, or the shot itself."""
        return self.subjects or (self,)

    def require_permission(self) -> None:
        """Raise UsageError for the first Python file that it would run without permission."""
        for part in self.parts:
            for flow in foreign_flows(part.motion.flow):
                flow.require_permission()

    @property
    def measures_speed(self) -> bool:
        """True if its colours, or those of one of its subjects, are the speed of the flow."""
        return any(part.picture.look.measures_speed for part in self.parts)

    def of_subject(self, name: str) -> Shot:
        """Return the shot with one of its subjects. Raises UsageError for a name that none has."""
        known = {part.subject: part for part in self.subjects}
        if name not in known:
            hint = suggest(name, known) if known else "It has one subject; leave the name out."
            raise UsageError(f"{self.name} has no subject {quote(name)}. {hint}")
        return known[name]

    @property
    def heading(self) -> str:
        """Its name and title in one line, for sheets; the name alone where the title repeats it."""
        repeats = re.sub(r"[\W_]+", " ", self.title.lower()) == re.sub(r"[\W_]+", " ", self.name.lower())
        return self.name if repeats else f"{self.name}: {self.title}"

    @property
    def frames(self) -> FrameRange:
        return self.motion.frames

    @property
    def rate(self) -> FrameRate:
        return self.motion.rate

    @property
    def loop(self) -> Loop | None:
        return self.motion.loop


@dataclass(frozen=True)
class Clip:
    """A shot in an edit: frames of it, in order.

    dissolve  frames of the dissolve from the entry before it
    """

    shot: Shot
    frames: FrameRange
    dissolve: int = 0

    def length(self, rate: FrameRate) -> int:
        """Return the length in frames at the film's rate, which is the shot's too."""
        return len(self.frames)


@dataclass(frozen=True)
class Card:
    """A title card between shots; `dissolve` as of a clip."""

    title: str
    subtitle: str = ""
    seconds: float = 2.0
    dissolve: int = 0
    style: CardStyle = PLAIN

    def length(self, rate: FrameRate) -> int:
        """Return the length in frames at the film's rate, rounded; 0 where the words lie over pictures."""
        return 0 if self.style.over else self.shown(rate)

    def shown(self, rate: FrameRate) -> int:
        """Return the number of frames with its words."""
        return round(self.seconds * float(rate.fps))


@dataclass(frozen=True)
class Film:
    """An edit: clips of shots and cards in order, and sound.

    entries  in order; title and credits, which are cards, first and last
    setting  gives its shots the shape of its pictures, in place of their own; or empty
    """

    title: str
    subtitle: str
    entries: tuple[Clip | Card, ...]
    rate: FrameRate
    sound: SoundTrack | None = None
    path: Path | None = field(default=None, metadata=NOT_PLAIN)
    setting: str = ""

    @property
    def clips(self) -> tuple[Clip, ...]:
        return tuple(entry for entry in self.entries if isinstance(entry, Clip))

    @property
    def shots(self) -> tuple[Shot, ...]:
        """The shot of each clip."""
        return tuple(clip.shot for clip in self.clips)

    @property
    def length(self) -> int:
        """Frames of the film with its cards; dissolves overlap."""
        return sum(each.length(self.rate) - each.dissolve for each in self.entries)

    @property
    def seconds(self) -> float:
        """Duration of the film with its cards."""
        return self.rate.seconds(self.length)

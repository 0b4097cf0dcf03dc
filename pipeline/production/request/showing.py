"""What the pictures of a take show, and where its files lie; nothing of keys."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from pipeline.frames import FrameRange
from pipeline.production.request.crop_and_scale import base_of, quality_named
from pipeline.production.request.shot_source import ShotSource
from pipeline.production.request.turntable import Turntable, TurntableAngle, framed_whole
from pipeline.production.store.paths import Folders

if TYPE_CHECKING:
    from pipeline.production.request.planning_cache import PlanningCache
    from pipeline.resample import Thresholds
    from pipeline.shot import Clock, Shot
    from pipeline.shot.camera import View
    from pipeline.shot.shot import AovSelection
    from render.scene.quality import Quality


@dataclass(frozen=True)
class Showing:
    """The pictures of one shot at one quality, rendered by one variant.

    script     what its shot is read from
    requested  the frames asked for
    home       the folder of its files, where it is not the shot's own; their names and seeds are the same
    """

    source: ShotSource
    quality_name: str
    variant: str
    requested: tuple[int, ...]
    turntable: Turntable | None = None
    home: str | None = None

    def as_data(self) -> dict[str, Any]:
        return {
            "script": self.source.as_data(),
            "quality": self.quality_name,
            "variant": self.variant,
            "requested": list(self.requested),
            "turntable": asdict(self.turntable) if self.turntable else None,
            "home": self.home,
        }

    @classmethod
    def from_data(cls, data: Mapping[str, Any], ledger: PlanningCache | None = None) -> Self:
        return cls(
            source=ShotSource.from_data(data["script"], ledger),
            quality_name=data["quality"],
            variant=data["variant"],
            requested=tuple(data["requested"]),
            turntable=Turntable(**data["turntable"]) if data["turntable"] else None,
            home=data["home"],
        )

    @property
    def shot(self) -> Shot:
        """Raises what `ShotSource.shot` raises."""
        return self.source.shot

    @property
    def name(self) -> str:
        """The shot's, which is known without reading it."""
        return self.source.name

    @cached_property
    def quality_of_shot(self) -> Quality:
        """As the shot says it."""
        return quality_named(self.quality_name, self.shot.picture.qualities)

    @property
    def aspect(self) -> float:
        """Width to height of the whole picture, whatever part of it is rendered and how small."""
        return self.shot.picture.qualities[base_of(self.quality_name)].aspect

    @cached_property
    def motion_folders(self) -> Folders:
        """Where mesh frames lie: with the shot, for its turntables too."""
        if self.home is not None:
            return Folders(Path(self.home), self.name)
        of_file = self.turntable and self.turntable.of_file
        return Folders.of_turntable(self.name) if of_file else Folders.of_shot(self.name)

    @cached_property
    def folders(self) -> Folders:
        """Where pictures lie."""
        if self.turntable is None:
            return self.motion_folders
        name = self.name if self.turntable.of_file else f"{self.name}.{self.turntable.at:04d}"
        return Folders.of_turntable(name, self.turntable.look)

    def places(self, kind: str, numbers: Iterable[int]) -> list[str]:
        """Where files are shown: the `mesh`, the `normals`, the `raw` picture, the finished `frame`, or a
        form of stills, of each number."""
        folders = self.motion_folders if kind in ("mesh", "normals") else self.folders
        return folders.numbered(kind, self.quality_name, numbers)

    def place(self, kind: str, number: int) -> Path:
        """The same of one number."""
        return Path(self.places(kind, (number,))[0])

    @property
    def subject(self) -> str:
        """What runs tell of: the shot, the turntable, or either with what is otherwise in it."""
        if self.turntable and self.turntable.look:
            return f"{self.folders.name} ({self.turntable.look})"
        return self.folders.name if self.home is None else f"{self.name} ({Path(self.home).name})"

    @property
    def label(self) -> str:
        return f"{self.folders.name}_{self.quality_name}" + ("_turntable" if self.turntable else "")

    @cached_property
    def angles(self) -> dict[int, TurntableAngle]:
        """By picture number, all that the take could show."""
        if self.turntable is None:
            return {number: TurntableAngle(number) for number in self.source.summary.frames}
        return self.turntable.angles()

    def whole(self) -> Self:
        """The same with every picture asked for."""
        return replace(self, requested=tuple(self.angles))

    @property
    def is_whole(self) -> bool:
        """Whether every picture of the take was asked for."""
        return set(self.requested) == set(self.angles)

    @property
    def movie_path(self) -> Path:
        return self.folders.movie(self.quality_name, None if self.is_whole else self._part)

    @property
    def _part(self) -> str:
        """What of it was asked for."""
        turn = self.turntable and self.turntable.turn_of(self.requested)
        return turn or str(FrameRange.of(self.requested))

    def thresholds(self, number: int) -> Thresholds:
        """Those of a frame; where resampling is off, for the sake of the hard angle, which shades creases."""
        from pipeline.production.keys.mesh_keys import thresholds_at

        return thresholds_at(self.shot.motion, number)

    @property
    def net_pieces(self) -> int | None:
        """How finely the surface of a net is cut, which is what cameras look at; None of other subjects."""
        from pipeline.shot.point_subjects import ControlNet

        is_net = isinstance(self.shot.motion.subject, ControlNet)
        return self.shot.picture.tessellate if is_net else None

    def view(self, number: int) -> View:
        """From where a picture is seen; a turntable stands still, and its stage needs an object in frame."""
        view = self.shot.picture.camera.at(self._clock.time(self.angles[number].mesh))
        if self.turntable is None or self.shot.picture.stage.kind != "turntable":
            return view
        return framed_whole(view)

    @cached_property
    def _clock(self) -> Clock:
        from pipeline.production.keys.mesh_keys import asked_in_order

        return asked_in_order(self.shot.motion).clock

    @property
    def follow(self) -> float:
        """How far the camera goes along with the sculpture; a turntable's does not."""
        return 0.0 if self.turntable else self.shot.picture.camera.follow

    @property
    def steadied_over(self) -> int:
        """Pictures to either side that light is taken from; what keeps its noise would not know its own."""
        return 0 if self.quality_of_shot.denoise == "off" else self.quality_of_shot.temporal_denoise

    @cached_property
    def layers(self) -> AovSelection:
        """Those that the shot asks for, and those that following its pixels to other frames takes."""
        asked = self.shot.picture.aovs
        return asked.adding("before", "after") if self.steadied_over else asked

    def open_at(self, number: int) -> tuple[float, float] | None:
        """When the shutter opens for a picture and closes, in frames from its moment; None: it shows one."""
        return self.shot.picture.shutter.open_at(self._clock.time(self.angles[number].mesh))

    def moments_beside(self, number: int) -> tuple[float, ...]:
        """How far a picture looks beyond its own moment, in frames, each way or none."""
        return (*(self.open_at(number) or ()), *self._moments_of_layers)

    @cached_property
    def _moments_of_layers(self) -> tuple[float, ...]:
        """The same of its layers, which look as far in every picture."""
        from pipeline.production.render_inputs.motion import STEP

        steps = {"velocity": (-STEP, STEP), "motion": (1.0,), "after": (1.0,), "before": (-1.0,)}
        return tuple(offset for name in self.layers.extra for offset in steps.get(name, ()))

    @cached_property
    def measures_speed(self) -> bool:
        """Whether the colours of its pictures are the speed of the flow."""
        from render.scene.measure import SPEED, Measure

        pattern = self.shot.picture.look.pattern
        return isinstance(pattern, Measure) and pattern.of == SPEED

    def goes_by_flow(self, number: int) -> bool:
        """Whether a picture needs its mesh, and the flow; a turntable's only turn."""
        return self.measures_speed or (self.turntable is None and bool(self.moments_beside(number)))

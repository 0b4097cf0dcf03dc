"""Export a shot as a USD stage: a root, a manifest of attributes, and a clip for each frame.

renders/<shot>/usd/<shot>.usda            what other programs open
renders/<shot>/usd/<shot>.manifest.usda   the attributes that clips hold
renders/<shot>/usd/<shot>.0001.usdc       the clip of a frame
renders/<shot>/usd/<shot>.sky.exr         what surrounds the scene, where it is not of one colour
renders/<shot>/usd/<shot>.colour.exr      the picture that colours the sculpture, where its look has one
renders/<shot>/usd/<shot>.keys.json       what each file was made from

Of several subjects, manifest, clips and colour are <shot>.<subject>.manifest.usda and so on, for each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import FrameError
from pipeline.plugins.interchange.exported_frame import KeyedFiles
from pipeline.plugins.interchange.usd_prims import sky_map, write_picture
from pipeline.plugins.interchange.usd_stage import SculptureFiles, write_root
from pipeline.production.request.cameras import camera_file
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.stages import EXPORT
from pipeline.production.store.store import Key, Store, key_of
from render.base.serialise import to_plain

if TYPE_CHECKING:
    from pipeline.production.request.framing import Framing


@dataclass(frozen=True, eq=False)
class UsdExport:
    """A shot's frames as a USD stage. Clips that are current are kept."""

    request: RenderRequest
    store: Store
    folder: Path

    @cached_property
    def files(self) -> KeyedFiles:
        """The files of the folder."""
        return KeyedFiles(self.folder, f"{self.request.name}.keys.json", self.store)

    @property
    def path(self) -> Path:
        """The path of the stage that other programs open."""
        return self.folder / f"{self.request.name}.usda"

    @cached_property
    def _sculptures(self) -> tuple[SculptureFiles, ...]:
        return tuple(SculptureFiles(part, self.store, self.files) for part in self.request.parts)

    def stale(self) -> list[int]:
        """Return the frames of the request with a clip that is missing, damaged, or of an earlier shot."""
        numbers = sorted(self.request.requested)
        return sorted({n for sculpture in self._sculptures for n in sculpture.stale(numbers)})

    def write(self, passed: Callable[[], None]) -> list[str]:
        """Write the clips that are not current, and what refers to them; return messages of failed frames.

        The stage shows all frames whose clips are current, those of earlier exports too. Raises MachineError
        where the disk refuses, FrameError where there are no cameras or no frame could be exported.
        """
        faults: list[str] = []
        framings = self._framings()
        with self.files.noting():
            for number in self.stale():
                try:
                    for sculpture in self._sculptures:
                        if sculpture.stale([number]):
                            sculpture.write_clip(number)
                except FrameError as error:
                    faults.append(f"{self.request.name} {error.of(number)}")
                passed()
            if not self.shown():
                raise FrameError("\n".join(faults))
            self._write_others(framings)
        return faults

    def shown(self) -> list[int]:
        """Return the frames whose clips are current, in ascending order."""
        return sorted(set.intersection(*(sculpture.shown() for sculpture in self._sculptures)))

    def _framings(self) -> Mapping[int, Framing]:
        """Return camera and set of every frame. Raises FrameError where they were not found."""
        framings = camera_file(self.request, self.store)
        if framings is None:
            raise FrameError(
                f"{self.request.name} has no cameras, which depend on all its frames, so no stage was "
                "written; fix the frames that fail, or export the existing ones as ply or obj"
            )
        return framings

    def _write_others(self, framings: Mapping[int, Framing]) -> None:
        """Write the manifests, the map of the sky and the root, each if it has changed."""
        for sculpture in self._sculptures:
            sculpture.write_others()
        request, shown, sky = self.request, self.shown(), f"{self.request.name}.sky.exr"
        lights = request.shot.picture.lights
        pixels = sky_map(lights) if request.shot.picture.look.is_lit else None
        if pixels is not None:
            key = key_of(EXPORT.recipe, to_plain(lights))
            self.files.update(sky, key, lambda draft: write_picture(draft, pixels))
        of_shown = {number: framings[number] for number in shown}
        self.files.update(
            self.path.name,
            self._root_key(of_shown),
            lambda draft: write_root(draft, request, self._sculptures, of_shown, sky),
        )

    def _root_key(self, framings: Mapping[int, Framing]) -> Key:
        shot, picture = self.request.shot, self.request.shot.picture
        several = [[each.prim, to_plain(each.look)] for each in self._sculptures]
        return key_of(
            EXPORT.recipe,
            shot.heading,
            str(shot.rate),
            [to_plain(part) for part in (picture.look, picture.lights, picture.stage)],
            (picture.camera.sensor_width, picture.camera.unit, self.request.aspect),
            {str(number): to_plain(framing) for number, framing in framings.items()},
            {str(number): self.request.open_at(number) for number in framings},
            *([several] if shot.subjects else []),
        )

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

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import FrameError
from pipeline.plugins.interchange.exported_frame import (
    KeyedFiles,
    colour_texture,
    frame_key,
    has_colours,
    stored_frame,
)
from pipeline.plugins.interchange.usd_prims import sky_map, write_picture
from pipeline.plugins.interchange.usd_stage import (
    SampledAttribute,
    StageContent,
    StageSculpture,
    sampled_attributes,
    sculpture_prim,
    write_clip,
    write_manifest,
    write_root,
)
from pipeline.production.request.cameras import camera_file
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.stages import EXPORT
from pipeline.production.store.store import Key, Store, key_of
from render.base.serialise import to_plain

if TYPE_CHECKING:
    from pipeline.production.request.framing import Framing


@dataclass(frozen=True, eq=False)
class SculptureFiles:
    """The files of one sculpture.

    request  of one subject
    files    those of the stage's folder
    """

    request: RenderRequest
    store: Store
    files: KeyedFiles

    def stale(self, numbers: Iterable[int]) -> list[int]:
        """Return the frames whose clips are missing, damaged, or of an earlier shot."""
        return [n for n in numbers if not self.files.is_current(self._clip(n), self._key(n))]

    def shown(self) -> set[int]:
        """Return the frames whose clips are current."""
        pattern = re.compile(re.escape(self._name) + r"\.(\d{4,})\.usdc")
        keys = self.files.keys()
        there = {int(match[1]): key for name, key in keys.items() if (match := pattern.fullmatch(name))}
        known = set(self.request.angles)
        return {n for n, key in there.items() if n in known and key == self._key(n)}

    def write_clip(self, number: int) -> None:
        """Write the clip of a frame. Raises FrameError where its mesh is missing or the flow fails."""
        frame = stored_frame(self.request, self.store, number)
        self.files.write(
            self._clip(number),
            self._key(number),
            lambda draft: write_clip(draft, self._prim, number, frame, self._attributes),
        )

    def write_others(self) -> None:
        """Write the manifest and the picture that colours the sculpture, each if it has changed."""
        names = [attribute.name for attribute in self._attributes]
        self._write_if_changed(
            self._manifest,
            key_of(EXPORT.recipe, self._prim, names),
            lambda draft: write_manifest(draft, self._prim, self._attributes),
        )
        texture = colour_texture(self.request.shot.picture.look)
        if texture is not None:
            self._write_if_changed(
                self._texture,
                key_of(EXPORT.recipe, to_plain(texture)),
                lambda draft: write_picture(draft, texture.pixels()),
            )

    def content(self, numbers: Iterable[int]) -> StageSculpture:
        """Return what the root stage holds of the sculpture, with the clips of these frames."""
        return StageSculpture(
            prim=self._prim,
            look=self.request.shot.picture.look,
            clips={number: self._clip(number) for number in numbers},
            manifest=self._manifest,
            texture=self._texture,
            is_cloud=self._is_cloud,
            attributes=self._attributes,
        )

    def _write_if_changed(self, name: str, key: Key, write: Callable[[Path], object]) -> None:
        if not self.files.is_current(name, key):
            self.files.write(name, key, write)

    def _key(self, number: int) -> Key:
        if number not in self._keys:
            self._keys[number] = frame_key(self.request, number)
        return self._keys[number]

    @cached_property
    def _keys(self) -> dict[int, Key]:
        return {}

    @cached_property
    def _attributes(self) -> tuple[SampledAttribute, ...]:
        look, copies = self.request.shot.picture.look, self.request.shot.motion.copies
        has_texture = look.texture_projection is not None
        return sampled_attributes(self._is_cloud, has_colours(look), has_texture, copies is not None)

    @cached_property
    def _is_cloud(self) -> bool:
        from pipeline.shot.point_subjects import Cloud

        return isinstance(self.request.shot.motion.subject, Cloud)

    @cached_property
    def _prim(self) -> str:
        return sculpture_prim(self.request.shot)

    @property
    def _name(self) -> str:
        return self.request.motion_folders.part_name

    def _clip(self, number: int) -> str:
        return f"{self._name}.{number:04d}.usdc"

    @property
    def _manifest(self) -> str:
        return f"{self._name}.manifest.usda"

    @property
    def _texture(self) -> str:
        return f"{self._name}.colour.exr"


@dataclass(frozen=True, eq=False)
class UsdExport:
    """A shot's frames as a USD stage. Clips that are current are kept.

    folder  of the stage, absolute
    """

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
        return self.folder / self._root

    @cached_property
    def _sculptures(self) -> tuple[SculptureFiles, ...]:
        return tuple(SculptureFiles(part, self.store, self.files) for part in self.request.parts)

    def stale(self) -> list[int]:
        """Return the frames of the request with a clip that is missing, damaged, or of an earlier shot."""
        numbers = sorted(self.request.requested)
        return sorted({n for sculpture in self._sculptures for n in sculpture.stale(numbers)})

    def write(self, passed: Callable[[], None]) -> list[str]:
        """Write the clips that are not current, and what refers to them; return messages of failed frames.

        passed  is called after each frame

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
                "written; fix "
                "the frames that fail, or export the existing ones as ply or obj"
            )
        return framings

    def _write_others(self, framings: Mapping[int, Framing]) -> None:
        """Write the manifests, the map of the sky and the root, each if it has changed."""
        for sculpture in self._sculptures:
            sculpture.write_others()
        lights = self.request.shot.picture.lights
        pixels = sky_map(lights) if self.request.shot.picture.look.is_lit else None
        if pixels is not None:
            self._write_if_changed(
                self._sky, key_of(EXPORT.recipe, to_plain(lights)), lambda draft: write_picture(draft, pixels)
            )
        content = self._content(framings)
        self._write_if_changed(self._root, self._root_key(content), lambda draft: write_root(draft, content))

    def _write_if_changed(self, name: str, key: Key, write: Callable[[Path], object]) -> None:
        if not self.files.is_current(name, key):
            self.files.write(name, key, write)

    def _content(self, framings: Mapping[int, Framing]) -> StageContent:
        request, shown = self.request, self.shown()
        return StageContent(
            shot=request.shot,
            sculptures=tuple(sculpture.content(shown) for sculpture in self._sculptures),
            framings={number: framings[number] for number in shown},
            shutters={number: request.open_at(number) for number in shown},
            sky=self._sky,
            aspect=request.aspect,
        )

    def _root_key(self, content: StageContent) -> Key:
        picture = self.request.shot.picture
        described = (picture.look, picture.lights, picture.stage)
        camera = (picture.camera.sensor_width, picture.camera.unit, content.aspect)
        several = [[sculpture.prim, to_plain(sculpture.look)] for sculpture in content.sculptures]
        return key_of(
            EXPORT.recipe,
            self.request.shot.heading,
            str(self.request.shot.rate),
            [to_plain(part) for part in described],
            camera,
            {str(number): to_plain(framing) for number, framing in content.framings.items()},
            {str(number): shutter for number, shutter in content.shutters.items()},
            *([several] if self.request.shot.subjects else []),
        )

    @property
    def _root(self) -> str:
        return f"{self.request.name}.usda"

    @property
    def _sky(self) -> str:
        return f"{self.request.name}.sky.exr"

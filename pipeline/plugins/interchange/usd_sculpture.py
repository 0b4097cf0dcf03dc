"""The files of one sculpture of a USD stage: clips of frames, a manifest, and the picture that colours it.

A shot of several subjects has one sculpture for each, whose files have its name.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from pipeline.plugins.interchange.exported_frame import colour_texture, frame_key, has_colours, stored_frame
from pipeline.plugins.interchange.keyed_files import KeyedFiles
from pipeline.plugins.interchange.usd_clips import (
    SampledAttribute,
    sampled_attributes,
    write_clip,
    write_manifest,
)
from pipeline.plugins.interchange.usd_lights import write_picture
from pipeline.plugins.interchange.usd_stage import StageSculpture, sculpture_prim
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.stages import EXPORT
from pipeline.production.store.store import Key, Store, key_of
from render.base.serialise import to_plain


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

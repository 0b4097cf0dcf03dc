"""Exports of one mesh of each subject with its motion: glTF, Alembic, vertex animation textures, pages."""

from __future__ import annotations

import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

from flowsculpt import FrameError, UsageError
from flowsculpt.api import Animation, plural
from flowsculpt.api.files import to_plain
from flowsculpt.api.frames import Framing, RenderRequest, Store, key_of
from flowsculpt.api.materials import Diffuse
from flowsculpt.pipeline.plugins.interchange.alembic_export import write_alembic
from flowsculpt.pipeline.plugins.interchange.animated_gltf import (
    Moving,
    quantized_animation,
    write_animated_gltf,
)
from flowsculpt.pipeline.plugins.interchange.carried_sequence import CarriedSequence
from flowsculpt.pipeline.plugins.interchange.drawn_mesh import DrawnMesh, KeyPoses
from flowsculpt.pipeline.plugins.interchange.exported_frame import EXPORT, KeyedFiles
from flowsculpt.pipeline.plugins.interchange.exported_materials import pictures_recipe
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh, even_step
from flowsculpt.pipeline.plugins.interchange.refining import Began
from flowsculpt.pipeline.plugins.interchange.unifying import Unification
from flowsculpt.pipeline.plugins.interchange.vertex_textures import VertexTextures
from flowsculpt.pipeline.plugins.interchange.web_player import PAGE, WebPage, require_three_js

_VERSION = 2  # of the formats as they are written here

_CLAY = Diffuse((0.73, 0.595, 0.46))  # of shapes without the look of their shot
_UNSEEN = 0.05  # error of vertices that players can do without, maximum edge lengths

_SMOOTH = 1 / 400  # distance of vertices from their true positions in players, of the sculpture's extent


@dataclass(frozen=True, eq=False)
class AnimationExport(ABC):
    """The files of an animation. Files that are current are kept.

    request  the frames of a shot, or of one of its subjects
    parts    one mesh of each subject in the files
    """

    request: RenderRequest
    store: Store
    folder: Path
    parts: tuple[Unification, ...]

    form: ClassVar[str]
    ends: ClassVar[tuple[str, ...]]

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the files; other programs open the first one."""
        return tuple(f"{self.name}.{end}" for end in self.ends)

    @property
    def facts(self) -> list[Any]:
        """JSON data that the content depends on besides meshes and looks."""
        return []

    @abstractmethod
    def write_files(self, meshes: list[OneMesh], began: Began) -> str:
        """Write the files; return how the motion is held, in words."""

    @property
    def readers(self) -> str:
        """The programs that read the files, and what others need; empty where every program reads them."""
        return ""

    @property
    def name(self) -> str:
        """The name of the shot in files, with that of the subject where it is one of several."""
        return self.request.motion_folders.part_name

    @property
    def path(self) -> Path:
        """The path of the file that other programs open."""
        return self.folder / self.names[0]

    @cached_property
    def files(self) -> KeyedFiles:
        """The files of the folder."""
        return KeyedFiles(self.folder, f"{self.name}.{self.form}.keys.json", self.store)

    @cached_property
    def key(self) -> str:
        """The key of the files."""
        looks = [part.request.shot.picture.look for part in self.parts]
        keys, plain = [part.key for part in self.parts], [to_plain(look) for look in looks]
        pictures = [name for look in looks for name in pictures_recipe(look)]
        return key_of(EXPORT.recipe, self.form, _VERSION, keys, plain, self.facts, *pictures)

    @property
    def is_current(self) -> bool:
        """True if all files are there, whole, and of these meshes."""
        return all(self.files.is_current(name, self.key) for name in self.names)

    @property
    def bytes(self) -> int:
        """The size of all files together."""
        return sum((self.folder / name).stat().st_size for name in self.names)

    def write(self, began: Began) -> tuple[list[OneMesh], str] | None:
        """Write the files; return the meshes, and how their motion is held. None where they are current.

        Raises what `Unification.one_mesh` raises, naming the subject, UsageError for what the format cannot
        hold, and MachineError where the disk refuses.
        """
        with self.files.changing():
            if self.is_current:
                return None
            meshes = _meshes(self.parts, began)
            return meshes, self.write_files(meshes, began)

    def moving(self, meshes: list[OneMesh], began: Began) -> list[Moving]:
        """Return the sculptures with their keyframes and looks."""
        return [
            Moving(mesh.name, _keyframes(mesh, began), part.request.shot.picture.look)
            for mesh, part in zip(meshes, self.parts, strict=True)
        ]


def animation(request: RenderRequest, store: Store, vertices: int) -> Animation:
    """Return the shape of all subjects in motion, for players: see `ShotExtras.animation`.

    Vertices that nobody sees are left out, as with `--until 0.05`. Raises UsageError for subjects that have
    no one mesh for all frames.
    """
    for part in filter(CarriedSequence.is_of, request.parts):  # of any number of vertices
        raise UsageError(f"{part.motion_folders.part_name} has other faces in each frame")
    parts = [Unification(part, store, vertices, _UNSEEN, is_plain=True) for part in request.parts]

    def glb(began: Began) -> bytes:
        meshes = _meshes(parts, began)
        moving = [Moving(mesh.name, _keyframes(mesh, began, _SMOOTH), _CLAY) for mesh in meshes]
        return quantized_animation(request.name, moving)

    return Animation(key_of(EXPORT.recipe, "animation", _VERSION, [part.key for part in parts]), glb)


def _meshes(parts: Iterable[Unification], began: Began) -> list[OneMesh]:
    """Return one mesh of each subject. Raises what `Unification.one_mesh` raises, naming the subject."""
    meshes = []
    for part in parts:
        try:
            meshes.append(part.one_mesh(began))
        except FrameError as error:
            raise FrameError(f"{part.name} {error}") from error
    return meshes


def _keyframes(mesh: OneMesh, began: Began, share: float = math.inf) -> KeyPoses:
    return KeyPoses.of(DrawnMesh.of(mesh), began("exporting", len(mesh.frames)), share)


def _keys_in_words(parts: list[Moving]) -> str:
    counts = " and ".join(plural(len(part.keyframes.numbers), "keyframe") for part in parts)
    return f"{counts}, at most {max(part.keyframes.error for part in parts):.2f} edges off"


@dataclass(frozen=True, eq=False)
class GltfExport(AnimationExport):
    """A GLB of all subjects with one clip; `plain` files need no extension."""

    plain: bool = False

    form = "gltf"
    ends = ("glb",)

    @property
    def facts(self) -> list[Any]:
        return [self.plain]

    @property
    def readers(self) -> str:
        compressed = "It is compressed with EXT_meshopt_compression"
        readers = "three.js, Babylon.js, model-viewer and Blender from 5.2 read"
        return "" if self.plain else f"{compressed}, which {readers}. --plain writes one for every program."

    def write_files(self, meshes: list[OneMesh], began: Began) -> str:
        parts = self.moving(meshes, began)
        self.files.write(
            self.names[0],
            self.key,
            lambda draft: write_animated_gltf(draft, self.request.name, parts, self.plain),
        )
        return _keys_in_words(parts)


@dataclass(frozen=True, eq=False)
class AlembicExport(AnimationExport):
    """An Alembic file of all subjects."""

    form = "abc"
    ends = ("abc",)

    def __post_init__(self) -> None:
        """Raise UsageError for frames that are not evenly spaced."""
        even_step(self.request.requested)

    def write_files(self, meshes: list[OneMesh], began: Began) -> str:
        title = self.request.shot.title or self.name
        self.files.write(self.names[0], self.key, lambda draft: write_alembic(draft, title, meshes, began))
        return "points and normals of each frame"


@dataclass(frozen=True, eq=False)
class VertexTextureExport(AnimationExport):
    """Vertex animation textures of one subject, with its mesh and what shaders need to know."""

    form = "vat"
    ends = ("glb", "positions.exr", "normals.png", "json")

    def __post_init__(self) -> None:
        """Raise UsageError for frames that are not evenly spaced."""
        even_step(self.request.requested)

    @property
    def facts(self) -> list[Any]:
        return ["round"] if self._is_round else []

    @property
    def _is_round(self) -> bool:
        return self.request.pictures.is_round and self.request.is_whole

    def write_files(self, meshes: list[OneMesh], began: Began) -> str:
        drawn = DrawnMesh.of(meshes[0])
        passed = began("exporting", len(drawn.mesh.frames))
        textures = VertexTextures.of(drawn, passed, self._is_round)
        look = self.parts[0].request.shot.picture.look
        mesh, positions, normals, facts = self.names
        named = {"mesh": mesh, "positions": positions, "normals": normals}
        self.files.write(mesh, self.key, lambda draft: textures.write_mesh(draft, look))
        self.files.write(positions, self.key, textures.write_positions)
        self.files.write(normals, self.key, textures.write_normals)
        self.files.write(facts, self.key, lambda draft: textures.write_facts(draft, named))
        return f"textures of {textures.layout.width} × {textures.layout.height} texels"


@dataclass(frozen=True, eq=False)
class WebExport(AnimationExport):
    """A page that plays all subjects, with light, floor and cameras of the shot."""

    form = "web"
    ends = ("html",)

    @cached_property
    def _framings(self) -> Mapping[int, Framing]:
        """Camera and stage of each frame. Raises FrameError where they were not found."""
        framings = self.request.pictures.framings(self.store)
        if framings is None:
            raise FrameError(
                f"{self.request.name} has no cameras, which depend on all its frames, so no page was "
                "written; fix the frames that fail"
            )
        return framings

    @property
    def facts(self) -> list[Any]:
        picture = self.request.shot.picture
        player = PAGE.in_one_file("", {})
        return [
            *(self.request.shot.heading, self.request.pictures.aspect, to_plain(picture.lights)),
            *(to_plain(picture.stage), picture.view.recipe, self.request.loop),
            {str(number): to_plain(self._framings[number]) for number in self.request.requested},
            hashlib.sha256((player + require_three_js()).encode()).hexdigest(),
        ]

    def write_files(self, meshes: list[OneMesh], began: Began) -> str:
        parts = self.moving(meshes, began)
        request = self.request
        page = WebPage(request.shot, parts, self._framings, request.pictures.aspect, request.loop)
        self.files.write(self.names[0], self.key, page.write)
        return _keys_in_words(parts)

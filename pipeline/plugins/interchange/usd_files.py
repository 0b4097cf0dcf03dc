"""Models in USD stages (.usd, .usda, .usdc, .usdz), which usd-core reads in a process of its own.

USD is C++ that may crash on a damaged file, and it prints what it warns of. The process answers with a line
of JSON, and for a surface with arrays as npz. Layers are looked for, and checked to be regular files, before
USD opens any.
"""

from __future__ import annotations

import json
import os
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.errors import FlowsculptError, MeshError, MissingInputError, brief, suggestion
from pipeline.mesh.mesh_formats import FileSurface, MeshFormat, ModelFiles, ScenePart
from pipeline.plugins.interchange.scene_readers import (
    answered,
    asked,
    joined,
    packed_surface,
    require_package,
    unpacked_surface,
)
from pipeline.plugins.interchange.usd_meshes import StageMeshes
from render.base.input_files import digest_of_file, joint_digest, require_input
from render.base.limited_process import MEMORY, allow_memory, serve
from render.base.user_cache import cache_path, load_answer, store_answer

if TYPE_CHECKING:
    from pxr import Sdf, Usd


_MODULE = "pipeline.plugins.interchange.usd_files"

_VERSION = 1
"""Goes up when the process answers otherwise about the same files."""

_WHOLE = ScenePart()


def require_usd() -> None:
    """Raise MachineError where the package that reads and writes USD is not installed."""
    require_package("USD files", "pxr", "usd-core (209 MB)", "usd")


def stage_files(path: Path) -> ModelFiles:
    """Return the stage's own file, and all that it names by references, payloads and so on.

    The disk cache keeps their names while their contents are the same. Raises MachineError without usd-core,
    MissingInputError where a file is missing, ParserError or MeshError where USD cannot read one.
    """
    require_usd()
    own, name = digest_of_file(path), str(path.absolute())
    cached = cache_path("parsed", ["usd", str(_VERSION), version("usd-core"), name, own])
    known = load_answer(cached) or {}
    digests: dict[str, str] = known.get("digests", {})
    if not digests or any(_digest(Path(file)) != digest for file, digest in digests.items()):
        facts = json.loads(_asked("facts", path, _WHOLE))
        digests = {name: own, **{file: digest_of_file(Path(file)) for file in facts["files"]}}
        known = {"up": facts["up"], "digests": digests}
        store_answer(cached, known)
    others = [(Path(file), digest) for file, digest in digests.items() if file != name]
    return ModelFiles(joint_digest(list(digests.values())), ((path, own), *others), known["up"])


def read_usd(path: Path, part: ScenePart = _WHOLE) -> FileSurface:
    """Read the meshes of a stage as one surface, in the coordinates and units of the stage.

    Edges between meshes are creases, and so are the creases of each. Raises as `stage_files`, and MeshError
    where there is no such prim, or no mesh.
    """
    require_usd()
    return unpacked_surface(_asked("surface", path, part))


USD = MeshFormat(read_usd, stage_files, states_up=True, read_part=read_usd)


def _digest(path: Path) -> str:
    """Return the digest of a file; empty where it cannot be read."""
    try:
        return digest_of_file(path)
    except MissingInputError:
        return ""


def _asked(question: str, path: Path, part: ScenePart) -> bytes:
    """Return what the process answers: facts as JSON, or a packed surface."""
    return asked(_MODULE, path, question, json.dumps([part.prim, part.time_code]))


MOST_BYTES = 1 << 30
"""Size of the largest layer."""

_MOST_LAYERS = 10_000

_ADDRESSES = 16 << 30
"""Bytes of addresses that USD may reserve on starting; it uses a tenth of them."""


def answer(path: str, question: str, options: str) -> bytes:
    """Return the answer to `facts` or `surface` about the stage at a path.

    options  prim and time code as JSON; null for those of the stage
    """
    _load_usd()
    from pxr import Tf

    try:
        return answered(lambda: _answer(path, question, *json.loads(options)))
    except Tf.ErrorException as error:
        raise ValueError(_first_words(error, path)) from None


def _answer(path: str, question: str, prim: str | None, time_code: float | None) -> bytes:
    allow_memory(MEMORY // 4 + 40 * require_input(Path(path), MOST_BYTES))
    layers = StageLayers(path)
    layers.open_all()
    allow_memory(MEMORY + 40 * layers.size)
    stage = _opened(path)
    if question == "facts":
        return json.dumps({"up": _up(stage), "files": list(layers.files)}).encode()
    return _surface(stage, prim, time_code)


def _load_usd() -> None:
    """Import USD and let it reserve addresses; limit memory afterwards.

    USD reserves over a gigabyte of addresses when it makes its first paths, and crashes where it cannot.
    """
    os.environ["PXR_WORK_THREAD_LIMIT"] = "1"  # each thread reserves more
    allow_memory(_ADDRESSES)
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateInMemory()
    mesh = UsdGeom.Mesh.Define(stage, "/mesh")
    mesh.CreatePointsAttr([(0.0, 0.0, 0.0)])
    UsdGeom.XformCache().GetLocalToWorldTransform(mesh.GetPrim())


@dataclass
class StageLayers:
    """The files of a stage, found without composing it.

    files  absolute paths of all layers except the stage itself
    size   of all layers, bytes
    """

    root: str
    files: dict[str, None] = field(default_factory=dict)
    size: int = 0

    def open_all(self) -> None:
        """Find all layers. Raises MissingInputError, or MeshError for too many of them."""
        self.size = require_input(Path(self.root), MOST_BYTES)
        seen, waiting = {self.root}, [self.root]
        while waiting:
            name = waiting.pop()
            for layer in _layers_named_in(name):
                if layer in seen:
                    continue
                self._require_file(layer, name)
                seen.add(layer)
                waiting.append(layer)
                if len(seen) > _MOST_LAYERS:
                    raise MeshError(f"it refers to over {_MOST_LAYERS} layers. Flatten the stage.")

    def _require_file(self, layer: str, named_in: str) -> None:
        """Note the file that holds a layer. Raises MissingInputError where it is no regular file."""
        from pxr import Ar

        package, inner = Ar.SplitPackageRelativePathOuter(layer)
        file = package if inner else layer
        if file == self.root or file in self.files:
            return
        try:
            self.size += require_input(Path(file), MOST_BYTES)
        except FlowsculptError as error:
            raise MissingInputError(f"its layer {Path(named_in).name} refers to {error}") from None
        self.files[file] = None


def _layers_named_in(name: str) -> Iterator[str]:
    """Yield the absolute paths of the layers that a layer refers to."""
    from pxr import Sdf

    layer = Sdf.Layer.FindOrOpen(name)
    if layer is None:
        raise ValueError(f"{Path(name).name} is not a USD layer")
    for asset in (*layer.GetCompositionAssetDependencies(), *_clips_of(layer)):
        if asset:
            yield layer.ComputeAbsolutePath(asset)


def _clips_of(layer: Sdf.Layer) -> Iterator[str]:
    """Yield the files that the value clips of a layer's prims name."""
    from pxr import Sdf

    paths: list[Sdf.Path] = []
    layer.Traverse(Sdf.Path.absoluteRootPath, paths.append)
    for path in paths:
        spec = layer.GetPrimAtPath(path) if path.IsPrimPath() else None
        sets = spec.GetInfo("clips") if spec is not None and spec.HasInfo("clips") else {}
        for clips in sets.values():
            if not isinstance(clips, dict):
                raise MeshError(f"{path}: its value clips are not a dictionary")
            if clips.get("templateAssetPath"):
                raise MeshError(
                    f"{path} uses a template for its value clips, which is not supported. "
                    "Flatten the stage at one frame."
                )
            yield from (asset.path for asset in clips.get("assetPaths") or ())
            manifest = clips.get("manifestAssetPath")
            if manifest is not None:
                yield manifest.path


def _opened(path: str) -> Usd.Stage:
    """Open a stage. Raises MeshError where its layers do not compose."""
    from pxr import Usd

    stage = Usd.Stage.Open(path)
    errors = stage.GetCompositionErrors()
    if errors:
        more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
        raise MeshError(f"its layers do not compose{more}: {_one_line(str(errors[0]), path)}")
    return stage


def _up(stage: Usd.Stage) -> str:
    from pxr import UsdGeom

    return "z" if UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z else "y"


def _surface(stage: Usd.Stage, prim: str | None, time_code: float | None) -> bytes:
    """Return the meshes of a prim as one surface, packed."""
    from pxr import Usd

    start = _start(stage, prim)
    if time_code is not None:
        time = Usd.TimeCode(time_code)
    elif stage.HasAuthoredTimeCodeRange():
        time = Usd.TimeCode(stage.GetStartTimeCode())
    else:
        time = Usd.TimeCode.EarliestTime()
    meshes = StageMeshes(time)
    meshes.add(start)
    if not meshes.placed.parts:
        where = "it" if start.IsPseudoRoot() else f"its prim {start.GetPath()}"
        others = f" Left out: {meshes.omitted_words}." if meshes.omitted else ""
        raise MeshError(
            f"{where} holds no mesh that is active, visible and of purpose default or render.{others} "
            f"{_remedy(stage)}"
        )
    return packed_surface(joined(meshes.placed.parts, meshes.notes()))


def _start(stage: Usd.Stage, prim: str | None) -> Usd.Prim:
    """Return the prim whose meshes are read. Raises MeshError where there is none of that path."""
    from pxr import Sdf

    if prim is None:
        default = stage.GetDefaultPrim()
        return default if default else stage.GetPseudoRoot()
    named = stage.GetPrimAtPath(prim) if Sdf.Path.IsValidPathString(prim) and prim[:1] == "/" else None
    if not named:
        known = [str(other.GetPath()) for other in stage.Traverse()]
        raise MeshError(f"it has no prim {brief(prim)}. {suggestion(prim, known) if known else ''}".rstrip())
    return named


def _remedy(stage: Usd.Stage) -> str:
    """Return a sentence that names prims with meshes, where the stage has some."""
    from pxr import UsdGeom

    meshes = [str(prim.GetPath()) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]
    if not meshes:
        return "Convert it to meshes in the program that made it."
    return f"Write prim: {brief(meshes[0])}, which is a mesh."


def _first_words(error: Any, path: str) -> str:
    """Return the first of the errors that USD collected about the stage at a path."""
    said = [part.commentary for part in error.args if hasattr(part, "commentary")]
    return _one_line(said[0] if said else str(error), path)


def _one_line(text: str, path: str) -> str:
    """Return what USD says on one line, with files by their names and without names of its C++ code."""
    plain = text.replace(f"{Path(path).parent}/", "").partition(" matching pxrInternal")[0]
    return textwrap.shorten(plain, 200, placeholder="…")


if __name__ == "__main__":
    serve(answer)

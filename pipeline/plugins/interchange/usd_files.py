"""Models in USD stages (.usd, .usda, .usdc, .usdz), and their paint, which usd-core reads in a process.

USD is C++ that may crash on a damaged file, and it prints what it warns of. The process answers with a line
of JSON, and for a surface with arrays as npz. Layers are looked for, and checked to be regular files, before
USD opens any.
"""

from __future__ import annotations

import json
import os
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

from flowsculpt import MissingInputError
from flowsculpt.api.files import CachedAnswer, InputFile, Parser
from flowsculpt.api.materials import Texture
from flowsculpt.api.meshes import (
    FileSurface,
    ModelMaterials,
    PaintReader,
    ScenePart,
    SourceFiles,
    SurfaceReader,
)
from flowsculpt.pipeline.plugins.interchange.model_paint import ModelPaint
from flowsculpt.pipeline.plugins.interchange.painted_materials import (
    FileMaterial,
    opacity_of,
    painted,
    picture,
    picture_within,
)
from flowsculpt.pipeline.plugins.interchange.scene_readers import (
    answered,
    asked,
    require_package,
    unpacked_surface,
)

_MODULE = "flowsculpt.pipeline.plugins.interchange.usd_files"

_VERSION = 1  # goes up when the process answers otherwise about the same files

_PAINT_VERSION = 5  # the same for answers about materials

_WHOLE = ScenePart()


def require_usd() -> None:
    """Raise MachineError where the package that reads and writes USD is not installed."""
    require_package("USD files", "pxr", "usd-core (209 MB)", "usd")


def stage_files(path: Path) -> SourceFiles:
    """Return the stage's own file, and all that it names by references, payloads and so on.

    The disk cache keeps their names while their contents are the same. Raises MachineError without usd-core,
    MissingInputError where a file is missing, ValueError or MeshError where USD cannot read one.
    """
    require_usd()
    own, name = InputFile(path).digest(), str(path.absolute())
    cached = CachedAnswer.of("parsed", ["usd", str(_VERSION), version("usd-core"), name, own])
    known = cached.load(_known_files)
    if known is None:
        facts = json.loads(_asked("facts", path, _WHOLE))
        known = facts["up"], {name: own, **{file: InputFile(Path(file)).digest() for file in facts["files"]}}
        cached.store(dict(zip(("up", "digests"), known, strict=True)))
    up, digests = known
    others = [(Path(file), digest) for file, digest in digests.items() if file != name]
    return SourceFiles.of(((path, own), *others), up)


def _known_files(answer: dict[str, Any]) -> tuple[Any, dict[str, str]]:
    """Return the axis that is up, and the digests of files, if no file has changed. Raises ValueError."""
    digests = dict(answer["digests"])
    if not digests or any(_digest(Path(file)) != digest for file, digest in digests.items()):
        raise ValueError("a file has changed")
    return answer["up"], digests


def read_usd(path: Path, part: ScenePart = _WHOLE) -> FileSurface:
    """Read the meshes of a stage as one surface, in the coordinates and units of the stage.

    Edges between meshes are creases, and so are the creases of each. Raises as `stage_files`, and MeshError
    where there is no such prim, or no mesh.
    """
    require_usd()
    return unpacked_surface(_asked("surface", path, part))


USD = SurfaceReader(read_usd, stage_files, states_up=True, read_part=read_usd)


def _materials(path: Path, part: ScenePart = _WHOLE) -> ModelMaterials:
    """Return the materials of a part of a stage in the order of its paint, and the files of their pictures.

    Raises MissingInputError where one is not there, MeshError for what is not read.
    """
    depends_on = [
        version("usd-core"),
        str(path.absolute()),
        stage_files(path).digest,
        str(part.prim),
        str(part.time_code),
    ]
    cached = CachedAnswer.of("parsed", ["usd paint", str(_PAINT_VERSION), *depends_on])

    def made(answer: dict[str, Any]) -> ModelMaterials:
        files: dict[Path, str] = {}
        parts = tuple(_material(path, facts, files) for facts in answer["materials"])
        notes = (note for facts in answer["materials"] for note in facts["notes"])
        return ModelMaterials(parts, files, tuple(notes))

    if (known := cached.load(made)) is not None:
        return known
    answer = {"materials": json.loads(_asked("materials", path, part))}
    cached.store(answer)
    return made(answer)


def _material(path: Path, facts: dict[str, Any], files: dict[Path, str]) -> FileMaterial:
    """Return the material of what the process found; note the files of its pictures."""
    textures = {
        name: replace(_texture(path, found, files), wrap=_wrap(found["wrap"], name, facts["is_beyond"]))
        for name, found in facts["pictures"].items()
    }
    colour, roughness = textures.get("diffuseColor"), facts["roughness"]
    more: dict[str, Any] = {"normal_texture": textures.get("normal")}
    factor = 1.0 if "opacity" in textures else facts["opacity"]
    more["opacity"] = opacity_of(factor, textures.get("opacity"), facts["opacityThreshold"] or None)
    if roughness is not None:
        more |= {f"{name}_texture": textures.get(name) for name in ("roughness", "metallic")}
    return painted(
        tuple(facts["colour"]), colour, roughness, facts["metalness"], facts["has_colours"], **more
    )


def _wrap(stated: list[str], name: str, is_beyond: bool) -> tuple[str, str]:
    """Return what is shown beyond the sides of a picture: black where nothing is stated (UsdUVTexture).

    is_beyond  tells whether any of it shows; otherwise the picture is read as one that repeats
    """
    across, up = (mode or ("black" if is_beyond else "repeat") for mode in stated)
    if name == "normal":  # black is not a direction
        across, up = ("clamp" if mode == "black" else mode for mode in (across, up))
    return across, up


def _texture(path: Path, found: dict[str, Any], files: dict[Path, str]) -> Texture:
    """Return a picture with the factor and the channel that show."""
    if found["digest"]:
        texture = picture_within(
            path,
            found["name"],
            found["digest"],
            lambda: asked(_MODULE, path, "picture", json.dumps([found["path"], None])),
            found["space"],
        )
    else:
        texture = picture(path, found["path"], files, found["space"])
    return replace(texture, factor=tuple(found["factor"]), channel=found["channel"])


def _paint(path: Path, part: ScenePart = _WHOLE) -> ModelPaint:
    require_usd()
    return ModelPaint.unpacked(_asked("paint", path, part))


def _paint_of_part(part: ScenePart) -> PaintReader:
    return PaintReader(partial(_materials, part=part), partial(_paint, part=part))


USD_PAINT = PaintReader(_materials, _paint, of_part=_paint_of_part)


def _digest(path: Path) -> str:
    """Return the digest of a file; empty where it cannot be read."""
    try:
        return InputFile(path).digest()
    except MissingInputError:
        return ""


def _asked(question: str, path: Path, part: ScenePart) -> bytes:
    """Return what the process answers: facts as JSON, or a packed surface."""
    return asked(_MODULE, path, question, json.dumps([part.prim, part.time_code]))


_ADDRESSES = 16 << 30  # bytes of addresses that USD may reserve on starting; it uses a tenth of them


def answer(path: str, question: str, options: str) -> bytes:
    """Return the answer to a question about a stage; `options` are prim and time code as JSON.

    To `picture` it is the content of the picture at the path that is the first option.
    """
    load_usd()
    from pxr import Tf

    from flowsculpt.pipeline.plugins.interchange.usd_reader import content_of_picture, one_line

    try:
        if question == "picture":
            return answered(lambda: content_of_picture(json.loads(options)[0]))
        return answered(lambda: _answer_about_stage(path, question, *json.loads(options)))
    except Tf.ErrorException as error:
        first = next((part.commentary for part in error.args if hasattr(part, "commentary")), str(error))
        raise ValueError(one_line(first, path)) from None


def _answer_about_stage(path: str, question: str, prim: str | None, time_code: float | None) -> bytes:
    """Return the answer to `facts`, `surface`, `paint` or `materials`; modules are imported as needed."""
    from flowsculpt.pipeline.plugins.interchange.usd_reader import facts_of, open_stage, surface_of

    stage, files = open_stage(path)
    if question == "facts":
        return facts_of(stage, files)
    if question == "surface":
        return surface_of(stage, prim, time_code)
    from flowsculpt.pipeline.plugins.interchange.usd_paint import answer_about_paint

    return answer_about_paint(stage, question, prim, time_code)


def load_usd() -> None:
    """Import USD and let it reserve addresses; limit memory afterwards.

    USD reserves over a gigabyte of addresses when it makes its first paths, and crashes where it cannot.
    """
    os.environ["PXR_WORK_THREAD_LIMIT"] = "1"  # each thread reserves more
    Parser.allow_memory(_ADDRESSES)
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.CreateInMemory()
    mesh = UsdGeom.Mesh.Define(stage, "/mesh")
    mesh.CreatePointsAttr([(0.0, 0.0, 0.0)])
    UsdGeom.XformCache().GetLocalToWorldTransform(mesh.GetPrim())


if __name__ == "__main__":
    Parser.serve(answer)

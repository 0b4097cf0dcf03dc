"""Materials of model files as materials of pictures, and the pictures that they name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from flowsculpt import FlowsculptError, MissingInputError
from flowsculpt.api import shorten
from flowsculpt.api.files import CachedAnswer, InputFile, atomic_write
from flowsculpt.api.materials import Diffuse, Opacity, PaintedFaces, Satin, Texture
from flowsculpt.api.pictures import RenderError

Colour = tuple[float, float, float]
"""Linear Rec.709 red, green and blue."""

FileMaterial = Diffuse | Satin
"""A material of a model's file."""

GREY = (0.604, 0.604, 0.604)
"""The colour of what a file leaves white: linear Rec.709 of sRGB 0.8, as Blender's."""


def painted(
    colour: Colour,
    texture: Texture | None,
    roughness: float | None = None,
    metallic: float = 0.0,
    has_colours: bool = False,
    opacity: Opacity | None = None,
    **textures: Any,
) -> FileMaterial:
    """Return a material with the texture coordinates of its model.

    roughness    0 to 1, as in glTF; None for a matt material
    has_colours  True where the model has vertex colours, which replace the colour
    opacity      where the surface has holes, or None
    textures     of normals, roughness and metalness, by the names of `Satin`
    """
    source: dict[str, Any] = {"colour_texture": texture, "opacity": opacity}
    if texture is None and has_colours:
        source["colour_from"] = PaintedFaces.COLOURS
    if roughness is None:
        return Diffuse(colour, **source, **textures).on_model()
    satin = Satin(colour, roughness=roughness, metallic=metallic, coat=0.0, **source, **textures)
    return satin.on_model()


def opacity_of(factor: float, texture: Texture | None = None, cutoff: float | None = None) -> Opacity | None:
    """Return the opacity of a material; None where all of the surface is there."""
    factor = min(max(factor, 0.0), 1.0)
    if texture is not None and texture.numbers().min() >= 1.0:
        texture = None
    is_whole = texture is None and (factor == 1.0 if cutoff is None else factor >= cutoff)
    return None if is_whole else Opacity(factor, texture, cutoff)


def mask_of(texture: Texture) -> Texture:
    """Return the opacity that a picture holds: its alpha, or its brightness where it has none."""
    alpha = alpha_of(texture)
    return alpha if alpha.numbers().min() < 1.0 else texture


def alpha_of(texture: Texture) -> Texture:
    """Return the alpha of a picture as a texture of numbers."""
    return replace(texture, space="data", factor=(1.0, 1.0, 1.0), channel=Texture.ALPHA)


def found_beside(model: Path, name: str) -> Path | None:
    """Return the file that a model names, or the one of its name beside the model: paths of other machines
    end there. None where there is neither."""
    written = name.replace("\\", "/")
    paths = (model.parent / written, model.parent / Path(written).name)
    return next((path for path in paths if path.is_file()), None)


def file_beside(model: Path, name: str, kind: str) -> Path:
    """Return the file that `found_beside` finds. Raises MissingInputError where there is none."""
    path = found_beside(model, name)
    if path is not None:
        return path
    place = model.parent / Path(name.replace("\\", "/")).name
    raise MissingInputError(
        f"{model}: it names its {kind} {name}, which is not there; it is looked for as {place}. Copy it "
        "there, or write paint: off"
    )


def picture(model: Path, name: str, files: dict[Path, str], space: str | None = None) -> Texture:
    """Return the picture that a model names, and note it. Raises MissingInputError, and as `read_picture`."""
    path = file_beside(model, name, "texture")
    files[path] = InputFile(path).digest()
    return Texture.of(str(path), files[path], space)


def _holds(path: Path, digest: str) -> bool:
    """Tell whether a file is there with content of a digest."""
    try:
        return InputFile(path).digest() == digest
    except FlowsculptError:
        return False


def picture_within(
    model: Path, name: str, digest: str, content: Callable[[], bytes], space: str | None
) -> Texture:
    """Return a picture that a model contains. It is written to the user's cache, and read from there.

    name     of the picture in the model
    digest   SHA-256 of its content
    content  returns it; called where the cache does not have it

    Raises as `read_picture`, with the model and the name.
    """
    suffix = Path(name.replace("\\", "/")).suffix.lower()
    cached = CachedAnswer.home() / "textures" / f"{digest}{suffix if suffix[1:].isalnum() else '.png'}"
    if not _holds(cached, digest):
        with atomic_write(cached, flush=False) as draft:
            draft.write_bytes(content())
    try:
        return Texture.of(str(cached), digest, space)
    except RenderError as error:
        message = str(error).replace(str(cached), f"{model}: its picture {shorten(name)}")
        raise type(error)(message) from None

"""Build materials that are written out for Mitsuba, and ask Mitsuba whether it accepts them.

Mitsuba alone knows the meaning of values. `refusal` asks it in a process of its own, since the caller may
still have to choose its engine, and stores the answer in the disk cache.
"""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from importlib.metadata import version
from typing import Any

import numpy as np

from flowsculpt.render.base import python_process
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.base.user_cache import CachedAnswer
from flowsculpt.render.mitsuba.engine import Engine
from flowsculpt.render.mitsuba.texture_coordinates import ScaledCoordinates, bitmap, to_uv
from flowsculpt.render.scene.materials.mitsuba_bsdf import Bsdf, Plain
from flowsculpt.render.scene.picture_file import Pixels
from flowsculpt.render.scene.texture_projection import TextureProjection
from flowsculpt.render.scene.textures import Texture

TIMEOUT = 60.0
"""Seconds that Mitsuba may take to check a material."""

_CRASHES = (signal.SIGSEGV, signal.SIGABRT, signal.SIGFPE, signal.SIGILL)

Refusal = tuple[tuple[str, ...], str]
"""The path of names to the refused part of a description, and Mitsuba's reason."""


def build(bsdf: Bsdf, coordinates: ScaledCoordinates, projection: TextureProjection) -> Any:
    """Return the BSDF, two-sided unless light passes through. Needs a started engine.

    Raises BadInputError where Mitsuba refuses it.
    """
    import mitsuba as mi

    try:
        made = mi.load_dict(_for_mitsuba(bsdf.description, bsdf.files, coordinates, projection))
        if mi.has_flag(made.flags(), mi.BSDFFlags.Transmission) or "TwoSided" in type(made).__name__:
            return made
        if bsdf.description["type"] in ("twosided", "null"):
            return made
        return mi.load_dict({"type": "twosided", "material": made})
    except RuntimeError as error:
        raise BadInputError(f"look's bsdf cannot be made: {parse_reason(str(error))[1]}") from None


def refusal(bsdf: Bsdf) -> Refusal | None:
    """Return where and why Mitsuba refuses a material, or None. Cached by text, files and version of Mitsuba.

    None also where the machine is too busy to ask: rendering will then report it.
    """
    parts = [version("mitsuba"), bsdf.text, *(file.digest for file in bsdf.files)]
    cached = CachedAnswer.of("materials", parts)
    stored = cached.load(lambda known: _refusals(known["refused"]))
    if stored is not None:
        return next(iter(stored), None)
    answer = _ask_process(bsdf)
    if answer is None:
        return None
    cached.store({"refused": answer})
    return next(iter(_refusals(answer)), None)


def _refusals(answer: Any) -> list[Refusal]:
    """Return the refusal in what `load_error` returned, if any. Raises TypeError or ValueError for others."""
    if answer == []:
        return []
    names, reason = list(answer)
    return [(tuple(map(str, names)), str(reason))]


def parse_reason(message: str) -> Refusal:
    """Return the part that an error message of Mitsuba names, and the message without source positions."""
    node = re.search(r'dictionary node "([^"]*)"', message)
    names = tuple(name for name in node[1].split(".") if name != "root") if node else ()
    text = re.sub(r'^.*?dictionary node "[^"]*": ', "", message, flags=re.DOTALL)
    text = re.sub(r'^failed to instantiate .*? plugin of type "[^"]*": ', "", text)
    text = re.sub(r"\[[\w.:]*\] ", "", text)
    return names, " ".join(text.split()).rstrip("!.")


def _for_mitsuba(
    part: Plain, files: tuple[Texture, ...], coordinates: ScaledCoordinates, projection: TextureProjection
) -> Plain:
    """Return a description with textures read and projected, and lists turned into colours."""
    if part["type"] == "rgb":
        return part
    made: Plain = {}
    for name, value in part.items():
        if isinstance(value, dict):
            value = _for_mitsuba(value, files, coordinates, projection)
        elif isinstance(value, list):
            value = {"type": "rgb", "value": value}
        made[name] = value
    if part["type"] == "measured":
        made["filename"] = files[part["filename"]].path
    if part["type"] == "checkerboard":
        made["to_uv"] = to_uv(coordinates, projection)
    if part["type"] == "bitmap":
        kept = {name: value for name, value in made.items() if name in ("filter_type", "wrap_mode")}
        made = {**bitmap(files[part["filename"]].pixels(), coordinates, projection), **kept}
    return made


def _ask_process(bsdf: Bsdf) -> Any:
    """Return `load_error` from a process of its own, or None where that fails."""
    question = json.dumps({"text": bsdf.text, "files": [file.path for file in bsdf.files]})
    try:
        done = subprocess.run(
            python_process.python_command("flowsculpt.render.mitsuba.bsdf_plugins"),
            input=question,
            env=python_process.environment(),
            capture_output=True,
            text=True,
            timeout=TIMEOUT,
        )
        if bsdf.files and -done.returncode in _CRASHES:
            return [[], "Mitsuba crashes on its files"]
        return json.loads(done.stdout) if done.returncode == 0 else None
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return None


class _GreyTexture(Texture):
    """A texture whose file is not read."""

    def pixels(self) -> Pixels:
        return np.full((2, 2, 3), 0.5, np.float32)


def load_error(bsdf: Bsdf) -> list[Any]:
    """Return where and why this process's Mitsuba refuses a material, or []. Textures are taken as grey."""
    import mitsuba as mi

    files = tuple(_GreyTexture(file.digest, file.space, file.path) for file in bsdf.files)
    nowhere = ScaledCoordinates(np.zeros((0, 2)))
    try:
        mi.load_dict(_for_mitsuba(bsdf.description, files, nowhere, TextureProjection()))
    except Exception as error:  # files may raise anything
        names, text = parse_reason(str(error))
        return [list(names), text]
    return []


def main() -> None:
    """Run the process that asks: a description and paths of files on stdin, the answer on stdout."""
    Engine("scalar_rgb", threads=1).start()
    question = json.loads(sys.stdin.read())
    files = tuple(Texture("", None, path) for path in question["files"])
    print(json.dumps(load_error(Bsdf(question["text"], files))), flush=True)


if __name__ == "__main__":
    main()

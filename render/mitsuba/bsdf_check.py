"""How Mitsuba gets a material that is written out, and what it has against it.

What values mean Mitsuba alone knows. It is asked in a process of its own, for the one that asks may have its
engine still to choose; its answers are remembered.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path
from typing import Any

from render.base.disk_cache import cache_path, load_answer, store_answer
from render.base.errors import BadInputError
from render.mitsuba import bitmaps as laid
from render.mitsuba.texture_coordinates import Marks
from render.scene.bsdf import Bsdf, Plain
from render.scene.texture_projection import Projection
from render.scene.textures import Texture

SECONDS = 60.0
"""How long Mitsuba may take to look at a material."""

_PACKAGE_ROOT = Path(__file__).resolve().parents[2]


def material(bsdf: Bsdf, marks: Marks, projection: Projection) -> Any:
    """As Mitsuba has it, seen from both sides unless light goes through. An engine must have been started.

    Raises BadInputError where Mitsuba does not take it.
    """
    import mitsuba as mi

    try:
        made = mi.load_dict(_for_mitsuba(bsdf.description, bsdf.files, marks, projection))
        if mi.has_flag(made.flags(), mi.BSDFFlags.Transmission) or "TwoSided" in type(made).__name__:
            return made
        if bsdf.description["type"] in ("twosided", "null"):
            return made
        return mi.load_dict({"type": "twosided", "material": made})
    except RuntimeError as error:
        raise BadInputError(f"look's bsdf cannot be made: {reason(str(error))[1]}") from None


def refusal(bsdf: Bsdf) -> tuple[tuple[str, ...], str] | None:
    """Where and why Mitsuba does not take a material, or None. Remembered by text and version of Mitsuba.

    Where that cannot be told, because the machine is too busy for one, None; the frame tells it then.
    """
    memory = cache_path("materials", [version("mitsuba"), bsdf.text])
    known = load_answer(memory)
    answer = known["refused"] if known is not None and "refused" in known else _asked(bsdf)
    if answer is None:
        return None
    if known is None:
        store_answer(memory, {"refused": answer})
    return (tuple(answer[0]), str(answer[1])) if answer else None


def reason(told: str) -> tuple[tuple[str, ...], str]:
    """The way to the part that Mitsuba speaks of, and what it says of it, without where in its own code."""
    node = re.search(r'dictionary node "([^"]*)"', told)
    way = tuple(step for step in node[1].split(".") if step != "root") if node else ()
    text = re.sub(r'^.*?dictionary node "[^"]*": ', "", told, flags=re.DOTALL)
    text = re.sub(r'^failed to instantiate .*? plugin of type "[^"]*": ', "", text)
    text = re.sub(r"\[[\w.:]*\] ", "", text)
    return way, " ".join(text.split()).rstrip("!.")


def _for_mitsuba(part: Plain, files: tuple[Texture, ...], marks: Marks, projection: Projection) -> Plain:
    """With pictures read, colours as such, and textures lying where the projection has them."""
    if part["type"] == "rgb":
        return part
    made: Plain = {}
    for name, value in part.items():
        if isinstance(value, dict):
            value = _for_mitsuba(value, files, marks, projection)
        elif isinstance(value, list):
            value = {"type": "rgb", "value": value}
        made[name] = value
    if part["type"] == "measured":
        made["filename"] = files[part["filename"]].path
    if part["type"] == "checkerboard":
        made["to_uv"] = laid.to_uv(marks, projection)
    if part["type"] == "bitmap":
        kept = {name: value for name, value in made.items() if name in ("filter_type", "wrap_mode")}
        made = {**laid.bitmap(files[part["filename"]].pixels(), marks, projection), **kept}
    return made


def _asked(bsdf: Bsdf) -> Any:
    """Where and why, or an empty list, as Mitsuba says in a process of its own; or None where it cannot."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(_PACKAGE_ROOT), *sys.path])}
    told = json.dumps({"text": bsdf.text, "files": [file.path for file in bsdf.files]})
    try:
        done = subprocess.run(
            [sys.executable, "-m", "render.mitsuba.bsdf_check"],
            input=told,
            env=environment,
            capture_output=True,
            text=True,
            timeout=SECONDS,
        )
        return json.loads(done.stdout) if done.returncode == 0 else None
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return None


def said_of(bsdf: Bsdf) -> list[Any]:
    """What this process's Mitsuba says: where and why, or nothing. Pictures are taken for grey ones."""
    import mitsuba as mi
    import numpy as np

    def plainly(part: Any) -> Any:
        if isinstance(part, list):
            return {"type": "rgb", "value": part}
        if not isinstance(part, dict) or part["type"] == "rgb":
            return part
        made = {name: plainly(value) for name, value in part.items() if name != "space"}
        if part["type"] == "measured":
            made["filename"] = bsdf.files[part["filename"]].path
        if part["type"] == "bitmap":
            del made["filename"]
            made["bitmap"] = mi.Bitmap(np.full((2, 2, 3), 0.5, np.float32))
        return made

    try:
        mi.load_dict(plainly(bsdf.description))
    except RuntimeError as error:
        way, text = reason(str(error))
        return [list(way), text]
    return []


def main() -> None:
    """The process that asks: a description and the paths of files on stdin, the answer on stdout."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    told = json.loads(sys.stdin.read())
    answer = said_of(Bsdf(told["text"], tuple(Texture("", None, path) for path in told["files"])))
    print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()

"""Models in USD stages (.usd, .usda, .usdc, .usdz), which usd-core reads in a process of its own.

USD is C++ that may crash on a damaged file, and it prints what it warns of; see `usd_reader`, the program of
that process.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pipeline.errors import MachineError, MeshError, MissingInputError
from pipeline.mesh.mesh_formats import FileSurface, ScenePart
from render.base.input_files import digest_of_file, joint_digest
from render.base.limited_process import answer_of
from render.base.python_process import command_line
from render.base.user_cache import cache_path, load_answer, store_answer

USD_FORMATS = ("usd", "usda", "usdc", "usdz")

PACKAGE, EXTRA = "usd-core", "usd"

READER = "pipeline.plugins.interchange.usd_reader"

_VERSION = 1
"""Goes up when `usd_reader.facts` answers otherwise about the same files."""


def require_usd() -> None:
    """Raise MachineError where the package that reads and writes USD is not installed."""
    if find_spec("pxr") is None:
        raise MachineError(
            f"USD files need the package {PACKAGE} (209 MB), which is not installed; install the extra "
            f"[{EXTRA}], or only the package, for the Python of flowsculpt: "
            f"{command_line('pip', 'install', PACKAGE)}"
        )


@dataclass(frozen=True)
class StageFiles:
    """The layers of a stage: its own file, and all files that it names by references, payloads and so on.

    up       axis of the stage that points up: y or z
    digests  SHA-256 of each file, by absolute path
    """

    up: str
    digests: dict[Path, str]

    @property
    def digest(self) -> str:
        """SHA-256 of the stage's own file, or of the digests of all its files."""
        return joint_digest(list(self.digests.values()))


def stage_files(path: Path) -> StageFiles:
    """Return the files of a stage. The disk cache keeps their names while their contents are the same.

    Raises MachineError without usd-core, MissingInputError where a file is missing, ParserError or MeshError
    where USD cannot read one.
    """
    require_usd()
    own = digest_of_file(path)
    cached = cache_path("parsed", ["usd", str(_VERSION), version(PACKAGE), str(path.absolute()), own])
    known = load_answer(cached) or {}
    stored: dict[str, str] = known.get("digests", {})
    if stored and all(_digest(Path(name)) == digest for name, digest in stored.items()):
        return StageFiles(known["up"], {Path(name): digest for name, digest in stored.items()})
    answer, _ = _answer("facts", path, ScenePart())
    digests = {path: own} | {Path(name): digest_of_file(Path(name)) for name in answer["files"]}
    store_answer(
        cached, {"up": answer["up"], "digests": {str(p.absolute()): digest for p, digest in digests.items()}}
    )
    return StageFiles(answer["up"], {p.absolute(): digest for p, digest in digests.items()})


_WHOLE = ScenePart()


def read_usd(path: Path, part: ScenePart = _WHOLE) -> FileSurface:
    """Read the meshes of a stage as one surface, in the coordinates and units of the stage.

    Edges between meshes are creases, and so are the creases of each. Raises as `stage_files`, and MeshError
    where there is no such prim, or no mesh.
    """
    require_usd()
    _, content = _answer("surface", path, part)
    return FileSurface.unpacked(content)


def _digest(path: Path) -> str:
    """Return the digest of a file; empty where it cannot be read."""
    try:
        return digest_of_file(path)
    except MissingInputError:
        return ""


def _answer(question: str, path: Path, part: ScenePart) -> tuple[dict[str, Any], bytes]:
    """Return what `usd_reader` answers: facts, and a packed surface."""
    options = json.dumps([part.prim, part.time_code])
    head, _, content = answer_of(READER, path, question, options).partition(b"\n")
    answer: dict[str, Any] = json.loads(head)
    if "missing" in answer:
        raise MissingInputError(f"{path}: {answer['missing']}")
    if "fault" in answer:
        raise MeshError(answer["fault"])
    return answer, content

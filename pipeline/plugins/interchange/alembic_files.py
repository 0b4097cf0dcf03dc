"""Models and moving meshes in Alembic archives, which alembic3d reads in a process of its own."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from flowsculpt import MeshError
from flowsculpt.api.files import InputFile, Parser
from flowsculpt.api.meshes import FileSurface, MovingSurface, ScenePart, SourceFiles, SurfaceReader
from flowsculpt.pipeline.plugins.interchange.moving_files import (
    LARGEST_CACHE,
    MovingFile,
    answer_about,
    first_sample,
)
from flowsculpt.pipeline.plugins.interchange.scene_readers import require_package

_MODULE = "flowsculpt.pipeline.plugins.interchange.alembic_files"


def require_alembic() -> None:
    """Raise MachineError where the package that reads and writes Alembic is not installed."""
    require_package("Alembic files", "alembic3d", "alembic3d (13 MB)", "alembic")


def _read(path: Path) -> FileSurface:
    """Read the meshes of an archive at its first sample. Raises MachineError without alembic3d."""
    require_alembic()
    return first_sample(path, _MODULE)


def _files(path: Path) -> SourceFiles:
    require_alembic()
    with InputFile(path).open() as (file, _):
        if file.read(4) == b"\x89HDF":
            raise MeshError("it is an archive of HDF5, as Alembic was until 2013. Export it as Ogawa.")
    return SourceFiles.of([(path, InputFile(path).digest())])


ALEMBIC = SurfaceReader(_read, _files)


def open_alembic(path: Path, part: ScenePart | None) -> MovingSurface:
    """Open the moving meshes of an archive: see `FileFormat.motion`. Raises as `_read`."""
    return MovingFile.opened(path, _MODULE, _files(path), "alembic3d")


def begin(path: str) -> Callable[[str], bytes]:
    """Return what answers about an archive."""
    size = InputFile(Path(path), LARGEST_CACHE).size()
    Parser.allow_memory(Parser.MEMORY + size + min(40 * size, LARGEST_CACHE))
    from flowsculpt.pipeline.plugins.interchange.alembic_samples import AlembicSource

    return answer_about(lambda: AlembicSource(path))


if __name__ == "__main__":
    Parser.serve_session(begin)

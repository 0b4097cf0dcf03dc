"""The formats of models of other programs: glTF, FBX, COLLADA, 3MF and USD."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from pipeline.mesh.mesh_formats import MeshFormat, ModelFiles, reader_of
from pipeline.plugins.interchange.collada_files import read_collada, up_of_collada
from pipeline.plugins.interchange.fbx_files import read_fbx, up_of_fbx
from pipeline.plugins.interchange.gltf_files import read_gltf, scene_files
from pipeline.plugins.interchange.threemf_files import read_threemf
from pipeline.plugins.interchange.usd_files import read_usd, stage_files
from render.base.input_files import digest_of_file, joint_digest


def _gltf_files(path: Path) -> ModelFiles:
    scene = scene_files(path)
    files = [(file, digest_of_file(file)) for file in (path, *scene.buffers)]
    return ModelFiles(joint_digest([*scene.reader, *(digest for _, digest in files)]), tuple(files))


def _usd_files(path: Path) -> ModelFiles:
    stage = stage_files(path)
    others = [(layer, digest) for layer, digest in stage.digests.items() if layer != path.absolute()]
    return ModelFiles(stage.digest, ((path, stage.digests[path.absolute()]), *others), stage.up)


def _one_file(up_of: Callable[[Path, str], str]) -> Callable[[Path], ModelFiles]:
    """Return a function that returns the one file of a model and the axis that it says is up."""

    def files(path: Path) -> ModelFiles:
        digest = digest_of_file(path)
        return ModelFiles(joint_digest([digest]), ((path, digest),), up_of(path, digest))

    return files


_up_of_collada = reader_of(up_of_collada)

GLTF = MeshFormat(read_gltf, _gltf_files)
FBX = MeshFormat(read_fbx, _one_file(up_of_fbx), states_up=True)
COLLADA = MeshFormat(
    reader_of(read_collada), _one_file(lambda path, digest: _up_of_collada(path)), states_up=True
)
THREEMF = MeshFormat(reader_of(read_threemf), _one_file(lambda path, digest: "z"), states_up=True)
USD = MeshFormat(read_usd, _usd_files, states_up=True, read_part=read_usd)

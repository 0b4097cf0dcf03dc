"""Mutated files for every reader of files from outside: sound samples, and what must hold for any mutation.

`python -m tests.fuzz.files 20000` tries so many files, `--kind glb` only those of one kind. Readers run in a
worker process, which also calls what `flowsculpt.render.base.limited_process` would start, so that a crash is
noticed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

from tests.fuzz.mutations import mutated
from tests.fuzz.samples import samples

MOST_SECONDS, MOST_BYTES, MOST_WORDS = 60.0, 512 << 20, 1200
CRASHING, CRASHED = ("stage", "fbx", "timeline"), "its reader crashed"
"""Kinds whose library may crash on a damaged file, and what the message then says."""

PATIENCE = 600.0
"""Seconds until a worker is ended; `MOST_SECONDS` are of its CPU."""


@dataclass(frozen=True)
class Attempt:
    """The result of reading a file; `fault` is empty where the reader behaved as it should."""

    fault: str
    message: str = ""
    seconds: float = 0.0
    megabytes: float = 0.0


def _model(path: Path) -> None:
    from flowsculpt.pipeline.shot.subjects import Model

    Model("", path=path, fit=2.0).build()


def _scene(path: Path) -> None:
    """Read glTF as `read_gltf` does, but in this process."""
    from flowsculpt.pipeline.errors import MeshError
    from flowsculpt.pipeline.mesh.mesh_formats import FileSurface
    from flowsculpt.pipeline.mesh.read import repair_surface
    from flowsculpt.pipeline.plugins.interchange.gltf_document import GltfDocument
    from flowsculpt.pipeline.plugins.interchange.gltf_files import SceneArrays
    from flowsculpt.pipeline.plugins.interchange.gltf_scene import DefaultScene
    from flowsculpt.render.base.input_files import parsing

    with parsing(path, "a scene", ""):
        surface = FileSurface.of(*SceneArrays(DefaultScene.of(GltfDocument.read(path))).surface(), base=None)
        if not len(surface.corners):
            raise MeshError("it has no faces")
        repair_surface(surface).mesh.triangulated()


def _paint(path: Path) -> None:
    """Read the paint and the materials of a glTF file, or those of an OBJ with a file of materials, here."""
    from flowsculpt.pipeline.plugins.interchange.gltf_paint import GLTF_PAINT, PaintArrays, PaintedScene
    from flowsculpt.pipeline.plugins.interchange.obj_paint import OBJ_PAINT
    from flowsculpt.render.base.input_files import parsing
    from flowsculpt.render.scene import textures

    textures.require_decodable = lambda path, digest: None  # in this process
    with parsing(path, "paint", ""):
        if path.suffix == ".mtl":
            model = path.with_suffix(".obj")
            model.write_text(f"mtllib a.mtl {path.name}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl one\nf 1 2 3\n")
            OBJ_PAINT.materials(model)
        elif path.suffix == ".obj":
            OBJ_PAINT.paint(path)
        else:
            PaintArrays(PaintedScene.read(path)).paint()
            GLTF_PAINT.materials(path)


def _stage(path: Path) -> None:
    """Read USD as `ModelFile.surface` does, but in this process; a crash there is a message to users."""

    from flowsculpt.pipeline.mesh.read import repair_surface
    from flowsculpt.pipeline.plugins.interchange.scene_readers import content_of, unpacked_surface
    from flowsculpt.pipeline.plugins.interchange.usd_files import answer
    from flowsculpt.render.base.input_files import parsing

    with parsing(path, "a stage", ""):
        answer(str(path), "facts", "[null, null]")
        content = content_of(answer(str(path), "surface", "[null, null]"), path)
        repair_surface(unpacked_surface(content)).mesh.triangulated()


def _fbx(path: Path) -> None:
    """Read FBX as `ModelFile.surface` does, but in this process; a crash there is a message to users."""

    from flowsculpt.pipeline.errors import MeshError
    from flowsculpt.pipeline.mesh.read import repair_surface
    from flowsculpt.pipeline.plugins.interchange.fbx_files import answer
    from flowsculpt.pipeline.plugins.interchange.scene_readers import content_of, unpacked_surface
    from flowsculpt.render.base.input_files import parsing

    with parsing(path, "FBX", ""):
        answer(str(path), "up")
        surface = unpacked_surface(content_of(answer(str(path), "surface"), path))
        if not len(surface.corners):
            raise MeshError("it has no faces")
        repair_surface(surface).mesh.triangulated()


def _points(path: Path) -> None:
    from flowsculpt.pipeline.plugins.points.point_files import read_points

    read_points(path)


def _net(path: Path) -> None:
    from flowsculpt.pipeline.plugins.points.point_files import read_net

    read_net(path, 4)


def _field(path: Path) -> None:
    from flowsculpt.pipeline.plugins.fields.grid_files import read_samples

    read_samples((path,))


def _decodable(path: Path, answer: Callable[[str], bytes], module: str, library: str, *options: str) -> str:
    """Ask in this process what `answer_about_content` asks in another, and store the answer."""
    from importlib.metadata import version

    from flowsculpt.render.base.input_files import InputFile, parsing
    from flowsculpt.render.base.user_cache import CachedAnswer

    digest = InputFile(path).digest()
    with parsing(path, "a file of its kind", ""):
        answered = answer(str(path))
    cached = CachedAnswer.of("parsed", [module, library, version(library), digest, *options])
    cached.store({"answer": answered.decode()})
    return digest


def _picture(path: Path) -> None:
    from flowsculpt.render.scene.textures import _decode, read_picture

    digest = _decodable(path, _decode, "flowsculpt.render.scene.textures", "OpenImageIO")
    read_picture.__wrapped__(str(path), digest, None)


def _sky(path: Path) -> None:
    from flowsculpt.render.scene.sky import read_map
    from flowsculpt.render.scene.textures import _decode

    digest = _decodable(path, _decode, "flowsculpt.render.scene.textures", "OpenImageIO")
    read_map.__wrapped__(str(path), digest)


def _sound(path: Path) -> None:
    from fractions import Fraction

    from flowsculpt.render.movie import movie_sound as sound

    _decodable(path, sound._counted, "flowsculpt.render.movie.movie_sound", "av", sound.TIMED)
    for _ in sound.blocks(sound.Sound(path, 0.1, fade_out=0.1), Fraction(2)):
        pass


def _view(path: Path) -> None:
    from flowsculpt.render.post import view
    from flowsculpt.render.post.config_tables import tables

    digest = _decodable(path, view._try_views, "flowsculpt.render.post.view", "OpenImageIO")
    tables(path)
    view._read.__wrapped__(str(path), digest)
    view.view_of(str(path), None, None, "LINEAR", digest)


def _lettering(path: Path, settings: dict[str, Any]) -> None:
    """Read outlines and extrude them as their own process does, but in this one."""
    from flowsculpt.pipeline.plugins.lettering import outline_process

    outlines = outline_process.Outlines(path, settings, "letter")
    outline_process.mesh_bytes(outline_process.read_outlines(outlines), {"depth": 0.25, "bevel": 0.001})


def _drawing(path: Path) -> None:
    _lettering(path, {"size": 2.0, "tolerance": 0.001})


def _font(path: Path) -> None:
    _lettering(path, {"text": "Ag1", "axes": []})


def _timeline(path: Path) -> None:
    """Read a timeline as its own process does, but in this one; of several faults the first is judged."""
    from flowsculpt.pipeline.errors import ShotError
    from flowsculpt.pipeline.plugins.delivery.imported_edit import ImportedEdit

    try:
        ImportedEdit(path, ("A",), path.parent, {"A": "1-24"}).text()
    except ShotError as error:
        raise ShotError(error.messages[0]) from None


def _flow(path: Path) -> None:
    from flowsculpt.pipeline.shot import read_shot

    text = "title: a\nframes: 1-2\nsubject: {solid: box}\nresample: {max_edge_length: 0.5}\n"
    text += "flows: [{python: {file: %s, function: move}}]\n"
    read_shot(path.with_name("shot.yaml"), text % path.name)


READERS: dict[str, Callable[[Path], None]] = {
    "model": _model,
    "scene": _scene,
    "paint": _paint,
    "stage": _stage,
    "fbx": _fbx,
    "points": _points,
    "net": _net,
    "field": _field,
    "picture": _picture,
    "sky": _sky,
    "sound": _sound,
    "view": _view,
    "drawing": _drawing,
    "font": _font,
    "timeline": _timeline,
    "flow": _flow,
}


def read(kind: str, path: Path) -> Attempt:
    """Read a file by the reader of a kind; return how it went, measured in this process."""
    from flowsculpt.pipeline.errors import FlowsculptError

    fault = message = ""
    before, start = _reset_peak(), time.process_time()
    try:
        READERS[kind](path)
    except FlowsculptError as error:
        message = str(error)
        if error.exit_code not in (2, 3):
            fault = f"exit code {error.exit_code}"
        elif len(message) > MOST_WORDS or len(message.split("\n")) > 3 or not message.isprintable():
            fault = "a message that is no short line"
    except BaseException as error:
        fault = f"{type(error).__name__} in {traceback.extract_tb(error.__traceback__)[-1].name}"
        message = "".join(traceback.format_exception(error)[-6:])
    seconds, size = time.process_time() - start, _peak() - before
    if seconds > MOST_SECONDS:
        fault = fault or "slow"
    if size > MOST_BYTES:
        fault = fault or "memory"
    return Attempt(fault, message, seconds, size / 2**20)


def _reset_peak() -> int:
    """Reset the peak of this process's memory; return what it holds now, bytes."""
    Path("/proc/self/clear_refs").write_text("5")
    return _peak()


def _peak() -> int:
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if "VmHWM" in line)
    return int(line.split()[1]) << 10


def _work(connection: Any, folder: Path) -> None:
    """Read the files whose kinds and paths come in; the parent ends this process where it hangs."""
    from flowsculpt.render.base.kernel_cache import cache_folder

    kernels, cache = cache_folder().parent, folder / "cache"
    os.environ["XDG_CACHE_HOME"] = str(cache)
    if not cache.is_dir():
        (cache / "flowsculpt").mkdir(parents=True)
        (cache / "flowsculpt/kernels").symlink_to(kernels)  # which need not be compiled again
    tempfile.gettempdir()  # which tries the folder by writing to it, once
    for stream in (sys.stdout, sys.stderr):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    sys.addaudithook(lambda event, given: _watch(event, given, str(folder), str(kernels)))
    while True:
        kind, path = connection.recv()
        _SEEN.clear()
        attempt = read(kind, path)
        if _SEEN and not attempt.fault:
            attempt = Attempt(f"did {_SEEN[0]}", attempt.message)
        resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        connection.send(attempt)


_SEEN: list[str] = []


def _watch(event: str, given: tuple[Any, ...], *allowed: str) -> None:
    """Note writes outside the allowed folders, processes and connections that a file causes."""
    if event == "open" and isinstance(given[0], str | bytes | Path):
        name = os.fsdecode(given[0])
        writes = isinstance(given[2], int) and given[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
        if writes and not name.startswith((*allowed, "/proc/self", "/dev/null")):
            _SEEN.append(f"open {name}")
    elif event in ("os.system", "subprocess.Popen", "os.exec", "os.posix_spawn", "socket.connect"):
        _SEEN.append(f"{event} {given[:2]}")


class Worker:
    """A process that reads files; after a crash or a hang another one is forked from one with the readers."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._start()

    def _start(self) -> None:
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload([Worker.__module__, "flowsculpt.pipeline.mesh.read"])
        self._connection, other = context.Pipe()
        self._process = context.Process(target=_work, args=(other, self.folder), daemon=True)
        self._process.start()
        other.close()

    def read(self, kind: str, path: Path) -> Attempt:
        self._connection.send((kind, path))
        try:
            if self._connection.poll(PATIENCE):
                attempt: Attempt = self._connection.recv()
                return attempt
            fault = "hang"
        except EOFError:
            self._process.join()
            code = self._process.exitcode or 0
            if kind in CRASHING:
                self._start()
                return Attempt("", CRASHED)
            fault = f"crash {signal.Signals(-code).name if code < 0 else code}"
        self.close()
        self._start()
        return Attempt(fault)

    def close(self) -> None:
        self._process.kill()
        self._process.join()


def attempts(
    seed: int, worker: Worker, kinds: tuple[str, ...] = ()
) -> Iterator[tuple[str, str, bytes, Attempt]]:
    """Yield kind, name, content and outcome of mutated files, without end, all kinds in turn."""
    random, folder = Random(seed), worker.folder
    known = [sample for sample in samples(folder / "samples") if not kinds or sample.kind in kinds]
    for sample in known:  # imports and compilation are not the files' fault
        worker.read(sample.kind, sample.path)
        attempt = worker.read(sample.kind, sample.path)
        assert not attempt.fault and not attempt.message, (sample.path.name, attempt)
    while True:
        for sample in known:
            content = mutated(sample.path.read_bytes(), random)
            path = folder / "tried" / sample.path.name
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)
            yield sample.kind, path.name, content, worker.read(sample.kind, path)


def main() -> None:
    """Try files, keep those with faults, and tell the faults by kind."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("count", type=int, nargs="?", default=1000)
    arguments.add_argument("--seed", type=int, default=0)
    arguments.add_argument("--kind", action="append", default=[], choices=sorted(READERS))
    arguments.add_argument("--keep", type=Path, default=Path(tempfile.gettempdir()) / "flowsculpt_fuzz")
    chosen = arguments.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="fuzz_"))
    tally: Counter[str] = Counter()
    slowest = largest = (0.0, "")
    worker = Worker(folder)
    try:
        for number, (kind, name, content, attempt) in enumerate(
            attempts(chosen.seed, worker, tuple(chosen.kind)), 1
        ):
            known = {"": "read", CRASHED: "refused, as the library crashed"}
            tally[known.get(attempt.message, "refused")] += not attempt.fault
            slowest, largest = (
                max(slowest, (attempt.seconds, name)),
                max(largest, (attempt.megabytes, name)),
            )
            if attempt.fault:
                tally[f"{kind}: {attempt.fault}"] += 1
                kept = chosen.keep / f"{chosen.seed}_{number}_{name}"
                kept.parent.mkdir(exist_ok=True)
                kept.write_bytes(content)
                print(f"{kept}: {attempt.fault} ({attempt.seconds:.1f} s, {attempt.megabytes:.0f} MiB)")
                print("   ", attempt.message.strip()[-1500:].replace("\n", "\n    "), flush=True)
            if number >= chosen.count:
                break
    finally:
        worker.close()
        shutil.rmtree(folder)
    for words, count in tally.most_common():
        print(f"{count:7} {words}")
    print(f"slowest {slowest[0]:.2f} s ({slowest[1]}), largest {largest[0]:.0f} MiB ({largest[1]})")


if __name__ == "__main__":
    main()

"""Alembic files of one mesh of each subject: points, normals and texture coordinates of all frames."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO

import numpy as np

from flowsculpt import MachineError
from flowsculpt.api.files import python_command
from flowsculpt.pipeline.plugins.interchange.one_mesh import OneMesh, even_step
from flowsculpt.pipeline.plugins.interchange.refining import Began


def write_alembic(path: Path, title: str, meshes: Sequence[OneMesh], began: Began) -> None:
    """Write the meshes, each with a sample at each frame.

    title  what the file says of itself
    began  counts the frames of all meshes

    Raises UsageError for frames that are not evenly spaced, FrameError where one cannot be read, and
    MachineError where the file could not be written.
    """
    step = even_step(meshes[0].frames)
    described = [
        {
            "name": mesh.name,
            "frames": mesh.frames,
            "step": step,
            "textured": mesh.texture is not None,
            "faces": len(mesh.faces),
            "points": len(mesh.rest),
            "normals": int(mesh.corner_normals.max()) + 1,
        }
        for mesh in meshes
    ]
    facts = {"title": title, "rate": float(meshes[0].rate.fps), "meshes": described}
    words = python_command("flowsculpt.pipeline.plugins.interchange.alembic_writer", str(path))
    pipe = subprocess.PIPE
    with subprocess.Popen(words, stdin=pipe, stderr=pipe) as writer:
        assert writer.stdin is not None and writer.stderr is not None
        try:
            writer.stdin.write(json.dumps(facts).encode() + b"\n")
            _send(writer.stdin, meshes, began)
            writer.stdin.close()
        except BrokenPipeError:  # its exit code says why
            with suppress(BrokenPipeError):
                writer.stdin.close()  # of what it has not taken
        except BaseException:
            writer.kill()
            raise
        said = writer.stderr.read().decode("utf-8", "replace").strip().splitlines()
    if writer.returncode:
        reason = said[-1].strip() if said else f"exit code {writer.returncode}"
        raise MachineError(f"{path.name} could not be written: {reason}. Is the disk full?")


def _send(pipe: IO[bytes], meshes: Sequence[OneMesh], began: Began) -> None:
    """Send the arrays that `alembic_writer` reads."""
    passed = began("exporting", sum(len(mesh.frames) for mesh in meshes))
    for mesh in meshes:
        pipe.write(mesh.faces.astype(np.int32).tobytes())
        pipe.write(mesh.corner_normals.astype(np.int32).tobytes())
        if mesh.texture is not None:
            pipe.write(mesh.texture.astype(np.float32).tobytes())
        for number in mesh.frames:
            frame = mesh.frame(number)
            pipe.write(frame.points.astype(np.float32).tobytes())
            pipe.write(frame.normals.astype(np.float32).tobytes())
            passed()

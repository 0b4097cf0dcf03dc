"""Record a show of this version, for later versions to open: `python -m tests.recorded.record`.

It writes VERSION.zip next to this file, with times and names of this machine replaced: a root with a rendered
shot, its notes and a published version, and the texts of the gallery's shots. Run it once for each release;
a recorded file is never written again.
"""

from __future__ import annotations

import getpass
import json
import os
import platform
import sys
import zipfile
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest import mock

from tests.conftest import commanded, done

HERE = Path(__file__).parent
GALLERY = HERE.parents[1] / "shots"
SHOT = "R010_recorded"
QUALITY = "draft.scale10"

DEFAULTS = "quality: {draft: {samples: 2, auxiliary_samples: 2, denoise: fast, temporal_denoise: 1}}\n"
FILM = f"title: Recorded\nshots: [{SHOT}]\ntitle_seconds: 0.5\ncredits_seconds: 0.5\n"
TEXT = """\
title: A box in two vortices, recorded
frames: 1-2
subject: {solid: box, size: [2, 1, 1]}
resample: {max_edge_length: 0.9}
flows:
  - sum:
      - vortex: {axis: z, centre: [0.9, 0.3, 0], radius: 0.8, strength: {keys: {1: 0, 2: 2}}}
      - vortex: {axis: y, centre: [-0.9, 0.3, 0], radius: 0.8, strength: -1.5}
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 2: 40}}}
look: clay
camera: {azimuth: {keys: {1: -24, 2: 38}}, elevation: 16}
"""
HOST = {"name": "workstation", "system": "Linux", "python": platform.python_version(), "machine": "x86_64"}
HOST |= {"processor": "processor", "cores": 2, "memory_mib": 8192}  # type: ignore[dict-item]

REVISION = {
    "shot": SHOT,
    "sequence": "v001 draft",
    "picture": "",
    "first": 1,
    "last": 2,
    "status": "change",
    "text": "More light from the left",
    "drawings": [
        {
            "frame": 1,
            "kind": "arrow",
            "ink": "#ffb000",
            "width": 40,
            "points": [100, 200, 3000, 2000],
            "text": "",
        }
    ],
    "author": "A. Director",
    "created": "2026-11-26T20:00:00.000Z",
    "modified": "2026-11-26T20:00:00.000Z",
    "deleted": False,
}
NOTE = {
    "id": "1b4e28ba-2fa1-4d2e-883f-0016d3cca427",
    **REVISION,
    "status": "approved",
    "modified": "2026-11-26T21:00:00.000Z",
    "history": [REVISION],
}


def make_show(root: Path) -> None:
    """Make the show in a folder: render the shot, take notes, publish it."""
    from flowsculpt.pipeline.production.execution.project import Project

    for folder, texts in {
        "shots": {f"{SHOT}.yaml": TEXT, "defaults.yaml": DEFAULTS, "film.yaml": FILM},
        "notes": {f"{SHOT}.json": json.dumps({"format": "flowsculpt notes", "version": 1, "notes": [NOTE]})},
        "gallery/shots": {path.name: path.read_text(encoding="utf-8") for path in GALLERY.glob("*.yaml")},
    }.items():
        (root / folder).mkdir(parents=True)
        for name, text in texts.items():
            (root / folder / name).write_text(text, encoding="utf-8")
    done(root, Project(root, 1, variant="scalar_rgb").pictures([SHOT], QUALITY))
    words = (
        "publish",
        SHOT,
        "-q",
        "draft",
        "--scale",
        "10%",
        "--variant",
        "scalar_rgb",
        "--note",
        "recorded",
    )
    code, said = commanded(root, *words)
    assert code == 0, said


def pack(root: Path, archive: Path) -> None:
    """Pack a show, without what is remade at any time; equal files give equal bytes."""
    remade = (
        {"tmp", "locks", "lock", "planning", "logs"},
        {"meshes", "normals", "raw"},
    )  # the second are links
    with zipfile.ZipFile(archive, "x", zipfile.ZIP_DEFLATED, compresslevel=9) as packed:
        for path in sorted(root.rglob("*")):
            name = path.relative_to(root)
            if path.is_file() and not remade[name.parts[0] == "renders"] & {*name.parts[1:4]}:
                content = path.read_bytes()
                assert str(root).encode() not in content, name
                packed.writestr(zipfile.ZipInfo(name.as_posix()), content, zipfile.ZIP_DEFLATED)


def main() -> None:
    """Record the version of this checkout, unless it is recorded."""
    from importlib.metadata import version

    archive = HERE / f"{version('flowsculpt')}.zip"
    if archive.exists():
        sys.exit(f"{archive} is there already: released versions are recorded once")
    with (
        TemporaryDirectory() as folder,
        mock.patch.object(platform, "node", lambda: "workstation"),
        mock.patch.object(getpass, "getuser", lambda: "artist"),
        mock.patch("flowsculpt.pipeline.plugins.versions.publishing.host", lambda: HOST),
    ):
        os.chdir(folder)
        make_show(Path(folder))
        pack(Path(folder), archive)
    print(f"{archive}: {archive.stat().st_size} bytes")


if __name__ == "__main__":
    main()

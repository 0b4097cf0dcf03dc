"""`python -m benchmarks.blender_scrub [EDGE]`: scrubbing a shot in Blender, frames a second.

A box of about 20,000 vertices (EDGE 0.068, the longest edge) is twisted over 24 frames and simulated. Blender
as a module, with the extension of `make blender-extension`, goes through all frames once, which reads them
from the store, then five times more with the meshes in memory. Each frame is evaluated, with triangles
and normals, as for a viewport; the upload to a GPU comes on top. Needs
`benchmarks/requirements-cycles.txt`: `make blender` installs it.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

from benchmarks.report import Target, keep, show
from tests.blender.test_extension import built_package, in_blender

SHOT = """\
title: A box, twisted
frames: 1-24
subject: {{solid: box, size: [2, 2, 2]}}
resample: {{max_edge_length: {edge}}}
flows:
  - twist: {{axis: y, amount: {{keys: {{1: 0, 24: 90}}}}}}
"""

LEAST = 15.0
"""Target: frames a second, once meshes are in memory."""


def main(edge: str = "0.068") -> None:
    with tempfile.TemporaryDirectory() as folder:
        shot = SHOT.format(edge=edge)
        found = json.loads(in_blender("measure", built_package(Path(folder)), Path(folder), shot))
    work = f"{found['vertices']} vertices"
    targets = [
        Target(work, "frames/s, read from the store", found["first_time"]),
        Target(work, "frames/s, in memory", found["in_memory"], least=LEAST),
    ]
    rows = [target.row for target in targets]
    show("Scrubbing in Blender", rows)
    keep("blender_scrub", rows)


if __name__ == "__main__":
    main(*sys.argv[1:])

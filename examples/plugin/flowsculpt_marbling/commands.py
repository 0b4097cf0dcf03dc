"""The command `inks`, and the format `csv` of the command `export`."""

from pathlib import Path

import numpy as np

from flowsculpt.api.commands import print_result
from flowsculpt.api.frames import animate
from flowsculpt.api.options import Common, Shot
from flowsculpt.api.shots import read_shot


def inks(common: Common) -> None:
    """List the inks of the look `marbling.inks`, as linear Rec.709.

    `flowsculpt inks`
    """
    from flowsculpt_marbling.inks import LAYERS

    lines = [f"{red:.3f} {green:.3f} {blue:.3f}" for red, green, blue in LAYERS.colours]
    print_result("\n".join(lines), {"inks": [list(colour) for colour in LAYERS.colours]}, common.json)


def csv(common: Common, shot: Shot) -> None:
    """Write a table of the vertices, faces and area of each frame's mesh.

    `flowsculpt export csv M010_comb` writes M010_comb.csv.
    """
    name = Path(shot).stem
    rows = ["frame,vertices,faces,area"]
    for frame in animate(read_shot(common.root / "shots" / f"{name}.yaml")):
        first, second, third = frame.mesh.vertices[frame.mesh.faces].swapaxes(0, 1)
        area = np.linalg.norm(np.cross(second - first, third - first), axis=1).sum() / 2.0
        rows.append(f"{frame.number},{len(frame.mesh.vertices)},{len(frame.mesh.faces)},{area:.6f}")
    path = common.root / f"{name}.csv"
    if not common.dry_run:
        path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    print_result(f"{path}: {common.done('written')}.", {"path": str(path)}, common.json)

"""From where frames of a quick look are seen: as renders will see them, once the whole shot is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipeline.arrays import AnyArray
from pipeline.dailies.preview.reel import Reel
from pipeline.production.surfaces.framing import Framing, frame_all, with_room
from pipeline.production.surfaces.sights import Balls
from pipeline.production.takes.take import Take


def aims(take: Take, reel: Reel, numbers: Sequence[int]) -> Mapping[int, Framing]:
    """Camera and stage of frames that the reel has played. Those of all the shot's are the render's own, but
    for the rounding of points to float32; those of a part are what its own frames ask for."""

    def points_of(index: int) -> AnyArray | Balls:
        arrays = reel.arrays(take, numbers[index])
        points = arrays["vertices"]
        return Balls(points, arrays["radii"]) if "radii" in arrays else points

    framings = frame_all([take.view(n) for n in numbers], points_of, take.aspect, take.follow)
    stage = take.shot.picture.stage
    return {n: with_room(framing, stage) for n, framing in zip(numbers, framings, strict=True)}

"""From where frames of a quick look are seen: as renders will see them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

from pipeline.arrays import AnyArray
from pipeline.dailies.preview.reel import Reel
from pipeline.production.render_inputs.framing import Framer, Framing, with_room
from pipeline.production.render_inputs.framing_geometry import Balls
from pipeline.production.request.render_request import Take

TOGETHER = 8
"""Frames after which it is asked again which cameras are settled."""


def aims(take: Take, reel: Reel, numbers: Sequence[int]) -> Mapping[int, Framing]:
    """Camera and stage of frames that the reel has played. Those of all the shot's are the render's own, but
    for the rounding of points to float32; those of a part are what its own frames ask for."""
    return dict(aimed(take, reel, numbers, numbers))


def aimed(
    take: Take, reel: Reel, played: Iterable[int], numbers: Sequence[int]
) -> Iterator[tuple[int, Framing]]:
    """The same while the reel plays them: each when its camera is settled."""

    def points_of(index: int) -> AnyArray | Balls:
        arrays = reel.arrays(take, numbers[index])
        points = arrays["vertices"]
        return Balls(points, arrays["radii"]) if "radii" in arrays else points

    framer = Framer([take.view(n) for n in numbers], points_of, take.aspect, take.follow)
    stage, left = take.shot.picture.stage, iter(numbers)
    for come, _ in enumerate(played, start=1):
        if come % TOGETHER == 0 or come == len(numbers):
            for framing in framer.framings(come):
                yield next(left), with_room(framing, stage)

"""The summary of a render request: all that planning needs of it again and again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from pipeline.production.request.cameras import cameras_key
from pipeline.production.store.store import Key
from render.scene.render_quality import Quality

if TYPE_CHECKING:
    from pipeline.production.request.render_request import RenderRequest


@dataclass(frozen=True)
class RequestSummary:
    """A render request as planning sees it.

    cameras      the key of its cameras
    reach        frames to either side that the temporal denoiser reads
    quality      the quality of all frames but those whose override has another
    precision    AOVs that the shot names, and `half` or `float`
    layers       the program whose channel names finished frames have; None without layers for compositing
    follow_flow  pictures that need their mesh and the flow; those of a turntable only turn
    need_mesh    pictures made of their mesh itself, not of what `smooth_normals` keeps for rendering
    overrides    frames of each override of the shot; a turntable has none
    restyled     frames whose look or lights an override changes
    """

    cameras: Key
    reach: int
    quality: Quality
    precision: tuple[tuple[str, str], ...]
    layers: str | None
    follow_flow: tuple[int, ...]
    need_mesh: tuple[int, ...]
    overrides: tuple[tuple[int, ...], ...] = ()
    restyled: tuple[int, ...] = ()

    @classmethod
    def of(cls, request: RenderRequest) -> RequestSummary:
        """Return the summary of a request. The shot is read only where the planning cache lacks it."""
        return request.source.cache.found_or_made(
            cls, lambda: cls._read(request), "request", request.identity
        )

    @classmethod
    def _read(cls, request: RenderRequest) -> RequestSummary:
        """Read the summary of a request from its shot."""
        picture, turntable = request.shot.picture, request.turntable
        follow_flow = tuple(
            n for n in request.angles if request.measures_speed or (turntable is None and request.offsets(n))
        )
        overrides = () if turntable else picture.overrides
        return cls(
            cameras=cameras_key(request),
            reach=request.temporal_reach,
            quality=request.quality_of_shot,
            precision=tuple(picture.aovs.precision),
            layers=picture.layers,
            follow_flow=follow_flow,
            need_mesh=follow_flow if picture.dicing is None else tuple(request.angles),
            overrides=tuple(override.frames.numbers for override in overrides),
            restyled=tuple(n for override in overrides if override.is_seen for n in override.frames),
        )

    def follows_flow(self, number: int) -> bool:
        """Tell whether a picture needs its mesh and the flow."""
        return number in self._follow_flow

    def needs_mesh(self, number: int) -> bool:
        """Tell whether a picture is made of its mesh itself."""
        return number in self._need_mesh

    def override_of(self, number: int) -> int | None:
        """Return the index of the override that a frame has, or None."""
        return self._overridden.get(number)

    def window(self, number: int, is_available: Callable[[int], bool]) -> tuple[int, ...]:
        """Return the frames that the temporal denoiser reads: available ones around `number`, no gaps.

        They have its look and lights.
        """
        first = last = number
        styles = self._styles

        def is_alike(other: int) -> bool:
            return styles.get(other) == styles.get(number) and is_available(other)

        while number - first < self.reach and is_alike(first - 1):
            first -= 1
        while last - number < self.reach and is_alike(last + 1):
            last += 1
        return tuple(range(first, last + 1))

    @cached_property
    def _follow_flow(self) -> frozenset[int]:
        return frozenset(self.follow_flow)

    @cached_property
    def _need_mesh(self) -> frozenset[int]:
        return frozenset(self.need_mesh)

    @cached_property
    def _overridden(self) -> dict[int, int]:
        """The index of the override of each frame that has one."""
        return {number: index for index, numbers in enumerate(self.overrides) for number in numbers}

    @cached_property
    def _styles(self) -> dict[int, int]:
        """The index of the override of each frame whose look or lights are not the shot's."""
        return {number: self._overridden[number] for number in self.restyled}

"""The interface of flows, mappings of points during a step of time."""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.flow.parameters import Vector

if TYPE_CHECKING:
    from flowsculpt.pipeline.kernels import BlockKernel

Displacement = Callable[[Points, float, float], Points]
"""Any callable `points, time, dt -> points` (P1)."""


class Flow(ABC):
    """A mapping of points into points, as it acts during a step of time.

    A flow is a value: pure, without memory, and it neither knows nor cares whether the points are
    particles, control points or the vertices of a mesh (P4).
    """

    @abstractmethod
    def displace(self, points: Points, time: float, dt: float) -> Points:
        """Return the positions of points (N, 3) `dt` seconds after `time`.

        `time` counts seconds from the start of the shot. The given points are not changed. `dt` may be
        negative: the flow then runs backwards.
        """

    @abstractmethod
    def cache_data(self, time: float, dt: float) -> Any:
        """Return all that decides `displace` over this step, JSON-able: equal data, equal motion."""

    def steps(self, time: float, dt: float) -> Iterator[FlowStep]:
        """Yield the flows that act one after another within this step: `displace` is all of them in order."""
        yield FlowStep(self, time, dt)

    def kernel_row(self, time: float, dt: float) -> tuple[BlockKernel, tuple[float, ...]] | None:
        """Return a compiled function that moves points as `displace` does, and its numbers, at most eleven.

        The function adds displacements where that of a field adds velocities. With it, new vertices go
        through many frames in one compiled call. None where there is none.
        """
        return None

    def undoes(self, time: float, before: Any) -> bool:
        """Tell whether its step from `time` on takes back the step `before`; carrying then skips both."""
        return False

    runs_code: ClassVar[bool] = False
    """True if it runs code of the user's, which can do anything: only with permission."""

    acts_around_earlier: ClassVar[bool] = False
    """True if `of_subject` put the flows before it into its own steps."""

    def require_permission(self) -> None:
        """Raise UsageError where it runs code without permission; `displace` does so too."""
        assert not self.runs_code, "flows that run code override this"

    @property
    def members(self) -> tuple[Flow, ...]:
        """The flows that act one after another: those of a sequence, else this one alone."""
        return (self,)

    @property
    def plugin_flow(self) -> Flow:
        """The flow as its plug-in made it, without what the core wraps around it."""
        return self

    def with_max_step(self, max_step: float) -> Flow:
        """Return the flow with no sub-step along velocities longer than `max_step` units."""
        return self

    def of_subject(self, subject: Any, place: Vector, before: Sequence[Flow]) -> Flow:
        """Return the flow as it acts on a subject that stands at a place, after or around those `before` it.

        Only flows of a list of flows are asked; compositions refuse flows that define this.
        """
        return self

    def beside(self, name: str, subjects: Mapping[str, Any]) -> Flow:
        """Return the flow as it acts on a subject beside `subjects`: motions by name; None: not read yet."""
        return self

    def _parts(self) -> Iterator[Flow]:
        """Yield the flows in it."""
        for name in getattr(self, "__dataclass_fields__", ()):
            value = getattr(self, name)
            parts = value if isinstance(value, tuple) else (value,)
            yield from (part for part in parts if isinstance(part, Flow))

    def findings(self) -> Iterator[tuple[str, bool]]:
        """Yield what to know of the flow before frames are made, and whether that is a warning.

        By default that of the flows in it. Raises FlowsculptError where the frames would fail.
        """
        for part in self._parts():
            yield from part.findings()

    def facts(self, time: float) -> Mapping[str, Any]:
        """Return what the headers of frames at `time` say of it, JSON-able; by default of the flows in it."""
        return {name: fact for part in self._parts() for name, fact in part.facts(time).items()}

    @property
    def faces_follow_normals(self) -> bool:
        """True where the resampler lets no face look against the normals that the flow carries.

        Other flows may make a surface thinner than its edges are long, where some faces must.
        """
        return False

    @property
    def rest_interval(self) -> int | None:
        """Frames after which the present surface becomes the one at rest, where the shot names none.

        None leaves it to `Resampling`; by default the fewest of the flows in it, for errors at rest stretch.
        """
        frames = (part.rest_interval for part in self._parts())
        return min((each for each in frames if each is not None), default=None)

    @property
    def name(self) -> str:
        """The name in error messages."""
        return type(self).__name__.lower()


class FlowStep(NamedTuple):
    """A flow that acts from `time` on, for `dt` seconds."""

    flow: Flow
    time: float
    dt: float


@dataclass(frozen=True)
class Function(Flow):
    """Any Python callable `points, time, dt -> points` as a flow (P1). It may write over its points."""

    displacement: Displacement

    def displace(self, points: Points, time: float, dt: float) -> Points:
        return self.displacement(points.copy(), time, dt)

    def cache_data(self, time: float, dt: float) -> Any:
        return {"function": self.name, "time": time, "dt": dt}

    @property
    def name(self) -> str:
        return getattr(self.displacement, "__qualname__", type(self.displacement).__name__)


@dataclass(frozen=True)
class PluginMap(Flow):
    """A map of a plug-in; `origin` is the plug-in, its version and the map's name, which enter keys."""

    flow: Flow
    origin: tuple[str, str, str]

    @property
    def plugin_flow(self) -> Flow:
        return self.flow

    def displace(self, points: Points, time: float, dt: float) -> Points:
        return self.flow.displace(points, time, dt)

    def cache_data(self, time: float, dt: float) -> Any:
        return {"plugin": self.origin, "data": self.flow.cache_data(time, dt)}

    def kernel_row(self, time: float, dt: float) -> tuple[BlockKernel, tuple[float, ...]] | None:
        return self.flow.kernel_row(time, dt)

    def of_subject(self, subject: Any, place: Vector, before: Sequence[Flow]) -> Flow:
        plain = [flow.plugin_flow for flow in before]
        return dataclasses.replace(self, flow=self.flow.of_subject(subject, place, plain))

    def beside(self, name: str, subjects: Mapping[str, Any]) -> Flow:
        return dataclasses.replace(self, flow=self.flow.beside(name, subjects))

    @property
    def faces_follow_normals(self) -> bool:
        return self.flow.faces_follow_normals

    @property
    def name(self) -> str:
        return self.origin[2]


def as_flow(flow: Flow | Displacement) -> Flow:
    """Return a flow unchanged, and any other callable wrapped as one."""
    return flow if isinstance(flow, Flow) else Function(flow)


def foreign_flows(flow: Flow) -> Iterator[Flow]:
    """Yield the flows that run code of the user's, of a composed flow."""
    stack: list[Any] = [flow]
    while stack:
        part = stack.pop(0)
        if isinstance(part, Flow) and part.runs_code:
            yield part
        elif isinstance(part, tuple | list):
            stack += part
        elif dataclasses.is_dataclass(part):
            stack += [getattr(part, f.name) for f in dataclasses.fields(part)]

"""A request in a plan: the keys of what it shows, and stand-ins for those that cameras decide."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from pipeline.production.request.cameras import CameraFile
from pipeline.production.request.keys import FrameKeys, PictureKeys
from pipeline.production.request.render_request import RenderRequest
from pipeline.production.store.store import Key, Store


class _PlaceholderFramings(CameraFile):
    """Stand-ins for framings that are not known yet: where these are equal, so will the framings be."""

    def __getitem__(self, number: int) -> Any:
        return {"cameras": self.key, "number": number}


class _PlaceholderKeys(dict[int, FrameKeys]):
    """Stand-ins for the keys of a request's pictures, which tell them apart within one shot file."""

    def __init__(self, request: RenderRequest) -> None:
        super().__init__()
        self._request, self._asked = request, frozenset(request.requested)

    def __missing__(self, number: int) -> FrameKeys:
        window = self._request.summary.window(number, self._asked.__contains__)
        raw = f"{self._request.identity}.{number}"
        self[number] = FrameKeys(raw, f"{raw}.{window[0]}.{window[-1]}", window)
        return self[number]


@dataclass(eq=False)
class PlanEntry:
    """A request in the plan, and what is known of its pictures.

    keys        those of its pictures; None where its cameras are not known
    comparable  what stands for the keys must tell equal pictures of other shot files
    meshes      mesh frames by number: wanted, present, or idle, where nothing needs them
    wholes      places of the requests that show the subject beside others, for an entry of one of several
    """

    place: int
    request: RenderRequest
    keys: PictureKeys | None
    store: Store
    comparable: bool
    meshes: dict[int, str] = field(default_factory=dict)
    wholes: list[int] = field(default_factory=list)

    @property
    def places(self) -> tuple[int, ...]:
        """The places of the requests that need what the entry needs."""
        return self.place, *self.wholes

    @cached_property
    def names(self) -> Mapping[int, FrameKeys]:
        """The keys of the pictures, or what stands for them until the cameras are known."""
        request = self.request
        if self.keys is not None:
            return self.keys
        if not self.comparable:
            return _PlaceholderKeys(request)
        key = f"promised {request.cameras_key}"
        framings = _PlaceholderFramings(self.store, key, request.angles, dict)
        return PictureKeys(request, self.store, framings)

    @cached_property
    def shown(self) -> list[int]:
        """The mesh frames that pictures of the whole request show."""
        return sorted({angle.mesh for angle in self.request.angles.values()})

    def require_permission(self) -> None:
        """Raises UsageError where the shot runs Python files, and may not."""
        if self.request.source.summary.runs_python:
            from pipeline.flow.flow import require_permission

            for part in self.request.shot.parts:
                require_permission(part.motion.flow)

    def numbers(self, state: str) -> list[int]:
        """Return the mesh frames in a state."""
        return sorted(n for n, found in self.meshes.items() if found == state)

    def mesh_keys(self, numbers: Sequence[int]) -> tuple[Key, ...]:
        """Return the keys of mesh frames, in order."""
        return tuple(map(self.request.mesh_key, numbers))

    def key(self, stage: str, number: int) -> Key:
        """The key by which a frame of a stage is known in the plan."""
        if stage == "simulate":
            return self.request.mesh_key(number)
        if stage == "smooth_normals":
            return self.request.normals_key(number)
        keys = self.names[number]
        if stage == "render":
            return keys.raw
        return keys.frame if stage == "finish" else self.request.still_key(stage, keys.frame)

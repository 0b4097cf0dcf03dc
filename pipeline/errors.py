"""Errors of shots, meshes and frames, each with the exit code that the command line answers with.

A message says place, fact, rule and remedy, in that order and in one line:
``shots/a.yaml:14:5: min_edge_length 0.03 is 60% of max_edge_length 0.05; it must be below 50%. Try 0.02.``
"""

from __future__ import annotations

from flowsculpt.render.base.render_errors import FlowsculptError as FlowsculptError
from flowsculpt.render.base.render_errors import MachineError as MachineError
from flowsculpt.render.base.render_errors import MissingInputError as MissingInputError
from flowsculpt.render.base.render_errors import quote as quote
from flowsculpt.render.base.render_errors import readable as readable
from flowsculpt.render.base.render_errors import reason_of as reason_of
from flowsculpt.render.base.render_errors import shorten as shorten
from flowsculpt.render.base.render_errors import suggest as suggest


class UsageError(FlowsculptError):
    """An impossible argument, option or value (exit code 2)."""


class ShotError(FlowsculptError):
    """Everything wrong with one shot file, one message a line (exit code 2)."""

    def __init__(self, *messages: str) -> None:
        super().__init__("\n".join(messages))
        self.messages = tuple(map(readable, messages))


class AbsentFilesError(ShotError):
    """A shot of whose frames only the first ones, the range `present`, have files that they show."""

    def __init__(self, message: str, present: str) -> None:
        super().__init__(message)
        self.present = present


class MeshError(FlowsculptError):
    """An unusable mesh: empty, not finite, not manifold (exit code 2)."""


class FrameError(FlowsculptError):
    """A frame that failed while others could be made (exit code 1).

    frame  its number, if known; the message then begins with it
    """

    exit_code = 1

    def __init__(self, message: str, frame: int | None = None) -> None:
        super().__init__(message if frame is None else f"frame {frame}: {message}")
        self.frame = frame

    def of(self, frame: int) -> FrameError:
        """Return this error with a frame, unless it has one."""
        return self if self.frame is not None else FrameError(str(self), frame)


class VertexBudgetError(FrameError):
    """A frame that would have more vertices than `max_vertices` allows; `fact` says how many."""

    def __init__(self, fact: str) -> None:
        super().__init__(f"{fact}; raise max_vertices or max_edge_length")
        self.fact = fact

    def with_remedy(self, settings: str, frame: int) -> FrameError:
        """Return the error of a frame, with settings that help as the first remedy."""
        return FrameError(f"{self.fact}; write {settings}, or raise max_vertices or max_edge_length", frame)

"""The flow `lag`, by which far parts of a subject follow the flows before it later."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from flowsculpt import Flow, Sequence, UsageError
from flowsculpt.pipeline.plugins.moves.carried import Carried
from flowsculpt.pipeline.plugins.moves.keyed_maps import KeyedMap, MapSequence, keyed_map
from flowsculpt.pipeline.plugins.moves.late_flow import LateFlow, Vector


@dataclass(frozen=True)
class Lag(LateFlow):
    """Lets the far parts of the subject follow the flows before it later: they drag, and swing out."""

    def of_subject(self, subject: Any, place: Vector, before: Any) -> Flow:
        """Return the flows before it, late: those back to one that acts on a whole subject, such as become.

        That one and what comes before it act in the subject's own place. Raises UsageError for a flow that
        cannot be late, and where there is none.
        """
        self.require_still(subject)
        own, maps = list(before), list[KeyedMap]()
        while own and not _acts_on_whole(last := own[-1].plugin_flow):
            own.pop()
            if isinstance(last, Carried):  # a move that is not late itself
                own += last.flows
                maps = [*last.maps.maps, *maps]
            elif type(last) is Sequence:
                own += last.flows
            else:
                maps.insert(0, _map_of(last))
        if not maps:
            own_lag = "; move has a lag of its own" * any(isinstance(flow, Carried) for flow in own)
            fact = f"no flow before lag can be late{own_lag}"
            raise UsageError(f"{fact}. Write one of these before it: {KINDS}.")
        return Carried(tuple(own), self, subject, place, MapSequence(maps))


def _map_of(flow: Flow) -> KeyedMap:
    """Return a flow as maps by keyed numbers. Raises UsageError for one that is none."""
    found = keyed_map(flow)
    if found is None:
        raise UsageError(
            f"{flow.name}, before lag, cannot be late: where it moves a point depends on all of the way "
            f"there. Write it after lag. {KINDS} can be late."
        )
    return found


KINDS = "move, translation, rotation, scaling, strain, twist, taper, stretch, shear and bend"


def _acts_on_whole(flow: Flow) -> bool:
    """Tell whether a flow acts on a whole subject, except a move that is not late."""
    if isinstance(flow, Carried):
        return bool(flow.late.seconds)
    return flow.acts_around_earlier or type(flow).of_subject is not Flow.of_subject

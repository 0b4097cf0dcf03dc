"""Records the strengths of flows at which a ball grows twofold and tenfold, for `flowsculpt flows NAME`.

`python -m tests.plugins.authoring.flow_strengths` records them again.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import flowsculpt.pipeline.plugins.authoring.shot_templates as templates
from flowsculpt.pipeline.errors import FlowsculptError
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.plugins.authoring.growth_forecast import GrowthForecast
from flowsculpt.pipeline.plugins.authoring.shot_schemas import facts
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.documents.flow_documents import FLOW_DOCUMENTS

RECORD = Path(templates.__file__).with_name("flow_strengths.yaml")
GROWTHS = (2.0, 10.0)
SEARCHED = np.geomspace(1e-2, 316.0, 19)

SHOT = """\
title: Growth
frames: 1-72
rate: 24
subject: {{solid: icosphere, radius: 1}}
resample: {{max_edge_length: 0.2}}
flows: [{{{flow}: {{{parameter}: {value}}}}}]
look: clay
"""


def growth_at(flow: str, parameter: str, value: float) -> float:
    """Return the vertices of the frame with the most, over those of the first; inf where the flow fails."""
    keys = f"{{keys: {{1: 0, 72: {value!r}}}}}" if facts(flow)["kind"] == "map" else repr(float(value))
    shot = read_shot(Path("growth.yaml"), SHOT.format(flow=flow, parameter=parameter, value=keys))
    ball = icosphere(8)
    forecasts = list(GrowthForecast(shot.motion, ball.vertices, ball.faces, len(ball.vertices)).frames())
    is_whole = bool(forecasts) and forecasts[-1].frame == 72
    return max(forecast.times for forecast in forecasts) if is_whole else float("inf")


def strength_of(flow: str) -> tuple[str, list[float]] | None:
    """Return the parameter that sets a flow's strength, and its values for GROWTHS; None if it has none."""
    parameters = facts(flow)["parameters"]
    found = [name for name in templates.STRENGTHS if any(p["name"] == name for p in parameters)]
    if not found or any(p["required"] and p["name"] != found[0] for p in parameters):
        return None
    try:
        growths = _growths(flow, found[0])
    except FlowsculptError:
        return None  # a parameter that takes no single number
    values = [_between(flow, found[0], growths, growth) for growth in GROWTHS]
    return None if values[0] is None else (found[0], [value for value in values if value is not None])


def _growths(flow: str, parameter: str) -> list[float]:
    """Return the growths at the searched values, up to the first large one: beyond it flows take long."""
    growths: list[float] = []
    for value in SEARCHED:
        growth = growth_at(flow, parameter, float(value))
        if growth == float("inf"):
            break
        growths.append(growth)
        if growth >= GROWTHS[-1]:
            break
    return growths


def _between(flow: str, parameter: str, growths: list[float], growth: float) -> float | None:
    """Return the value with that growth, to two digits, where the searched values embrace it."""
    k = next((k for k, found in enumerate(growths) if found >= growth), 0)
    if k == 0:
        return None
    low, high = SEARCHED[k - 1], SEARCHED[k]
    for _ in range(7):
        middle = float(np.sqrt(low * high))
        low, high = (low, middle) if growth_at(flow, parameter, middle) >= growth else (middle, high)
    return float(f"{high:.2g}")


def main() -> None:
    lines = [
        "# By flow: the parameter that sets its strength, and values with which a ball of radius 1 at the"
    ]
    lines += [
        "# origin takes 2 and 10 times the vertices within 3 s; "
        "`python -m tests.plugins.authoring.flow_strengths`."
    ]
    for flow in sorted(FLOW_DOCUMENTS):
        found = strength_of(flow)
        if found is not None:
            lines.append(f"{flow}: {{{found[0]}: [{', '.join(f'{value:g}' for value in found[1])}]}}")
            print(lines[-1], flush=True)
    RECORD.write_text("\n".join([*lines, ""]), encoding="utf-8")


if __name__ == "__main__":
    main()

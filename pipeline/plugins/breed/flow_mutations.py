"""Mutations of what moves a shot: strengths, places, directions, times, and the flows themselves.

Each changes a draft and returns what changed in a few words, or an empty text where it does not apply.
Strengths and lengths change by factors, directions by turns, and times by a warp that keeps their order.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from typing import Any

from flowsculpt.api.shots import FLOW_DOCUMENTS, is_number
from flowsculpt.pipeline.plugins.breed.gene_values import (
    AXES,
    EXPONENTS,
    STRENGTHS,
    Chance,
    at_times,
    mapped,
    rounded,
    scaled,
    times_of,
    turned,
    vector_of,
)
from flowsculpt.pipeline.plugins.breed.shot_genome import COMPOSITIONS, Genome, Leaf, flow_lists, leaves_of

USUAL_SECONDS = 2.4
"""Seconds in which a flow of the palette acts with its usual strength: those of a shot of 3 s."""

FARTHEST = 1.5
"""Distance of a flow's centre from the middle of the subject, in half-sizes, at most."""

EASINGS = ("sine_in_out", "cubic_in_out", "quad_out", "cubic_out", "expo_out", "quad_in_out", "linear")
"""Easings that never overshoot: a radius may not pass zero."""

CARRYING = ("move", "contact")
"""Entries that act on a whole subject, after all others."""


@dataclass
class Draft:
    """A child while it is made: its data, where it comes from, chance, and a few words on each change."""

    parent: Genome
    data: dict[str, Any]
    chance: Chance
    words: list[str] = field(default_factory=list)

    def leaves(self) -> list[Leaf]:
        """Return all flows of the catalogue in the shot and its subjects."""
        return [leaf for flows in flow_lists(self.data) for leaf in leaves_of(flows)]

    def pick(self) -> Leaf | None:
        """Return a flow by chance. A translation only holds the subject where it is."""
        leaves = [leaf for leaf in self.leaves() if leaf.name != "translation"]
        return self.chance.random.choice(leaves) if leaves else None

    def group(self, leaf: Leaf) -> list[Leaf]:
        """Return the flows that belong to one: those of its kind in the same entry, such as a pair."""
        return [each for each in self.leaves() if each.holder is leaf.holder and each.name == leaf.name]


Idea = Callable[[Draft], str]


@cache
def palette() -> dict[str, dict[str, Any]]:
    """Return the rows of `flow_palette.yaml` by flow, without flows of plug-ins that are not installed."""
    from ruamel.yaml import YAML  # takes time to import

    text = resources.files(__package__).joinpath("flow_palette.yaml").read_text(encoding="utf-8")
    rows = YAML(typ="safe", pure=True).load(text)
    return {name: row for name, row in rows.items() if name in FLOW_DOCUMENTS}


def called(leaf: Leaf, count: int = 1) -> str:
    """Return the name of a flow, or of several, as prose has it: vortex ring, vortices."""
    name = leaf.name.rpartition(".")[2].replace("_", " ")
    if count == 1:
        return name
    return f"{name.removesuffix('ex')}ices" if name.endswith("ex") else f"{name}s"


def described(leaf: Leaf, adjective: str, count: int) -> str:
    """Return `a stronger twist`, or `stronger vortices`."""
    return f"{adjective} {called(leaf, count)}" if count > 1 else f"a {adjective} {called(leaf)}"


def drift(draft: Draft) -> None:
    """Change all numbers of all flows a little; equal ones alike."""
    chance = draft.chance
    width = 0.35 * chance.amount
    for leaf in draft.leaves():
        factor = chance.shared(("entry", id(leaf.holder), leaf.entry), lambda: chance.factor(width))
        for name in [*leaf.values]:
            form, positive = _form(leaf, name)
            if name in STRENGTHS and form != "vector":
                _scale_strength(leaf, name, factor)
            elif name in STRENGTHS:
                leaf.values[name] = scaled(leaf.values[name], factor)
            elif name == "with" and isinstance(leaf.values[name], dict):
                numbers = leaf.values[name]
                for word in numbers:
                    own = chance.shared(("with", word), lambda: chance.factor(width))
                    numbers[word] = scaled(numbers[word], own)
            elif positive and form in ("number", "constant") and name != "period":
                own = chance.shared(
                    (leaf.name, name, _first(leaf.values[name])), lambda: chance.factor(width)
                )
                leaf.values[name] = scaled(leaf.values[name], own)
            elif name == "centre":
                _move(draft, leaf, 0.12 * chance.amount)


def stronger(draft: Draft) -> str:
    """Make one flow, or a pair, much stronger or weaker."""
    leaf = draft.pick()
    if leaf is None:
        return ""
    name = next((name for name in STRENGTHS if name in leaf.values), "")
    if not name:
        return ""
    up = draft.chance.happens(0.6)
    width = 0.35 + 1.6 * draft.chance.amount * draft.chance.random.uniform(0.4, 1.0)
    if palette().get(leaf.name, {}).get("family") == "turbulence":
        width *= 0.4  # more of it crumples a surface
    factor = 1.0 + width if up else 1.0 / (1.0 + width)
    group = draft.group(leaf)
    for each in group:
        if name in each.values:
            _scale_strength(each, name, factor)
    return described(leaf, "stronger" if up else "gentler", len(group))


def reversed_strength(draft: Draft) -> str:
    """Reverse one flow, or a pair."""
    leaf = draft.pick()
    if leaf is None or leaf.name in ("stretch", "curl_noise", "sink"):
        return ""
    name = next((name for name in ("strength", "rate", "speed", "amount", "flux") if name in leaf.values), "")
    if not name:
        return ""
    group = draft.group(leaf)
    for each in group:
        if name in each.values:
            each.values[name] = scaled(each.values[name], -1.0)
    return f"the {called(leaf, len(group))} reversed"


def tilted(draft: Draft) -> str:
    """Tilt the axis of one flow, or of all in its entry that share it; or give it another main axis."""
    chance, leaf = draft.chance, draft.pick()
    if leaf is None or not any(p.name == "axis" for p in leaf.document.parameters):
        return ""
    old = _axis(leaf)
    group = [
        each
        for each in draft.leaves()
        if each.entry == leaf.entry and _has_axis(each) and _axis(each) == old and each.holder is leaf.holder
    ]
    if isinstance(old, str) and chance.happens(0.3 + 0.3 * chance.amount):
        new = chance.random.choice([name for name in AXES if name != old])
        about, degrees = vector_of(({"x", "y", "z"} - {old, new}).pop()), 90.0
        words = f"the {called(leaf, len(group))} about {new}"
    else:
        about, new = chance.direction(), ""
        degrees = 10.0 + 70.0 * chance.amount * chance.random.uniform(0.4, 1.0)
        words = described(leaf, "tilted", len(group))
    for each in group:
        each.values["axis"] = new or turned(old, about, degrees)
        if any(p.name == "direction" for p in each.document.parameters):
            each.values["direction"] = turned(each.values.get("direction", "x"), about, degrees)
    return words


def moved(draft: Draft) -> str:
    """Move the place of one flow, and of those that mirror it."""
    leaf = draft.pick()
    if leaf is None or not any(p.name == "centre" for p in leaf.document.parameters):
        return ""
    leaf.values.setdefault("centre", [0, 0, 0])
    group = draft.group(leaf)
    for each in group:
        if "centre" in each.values:
            _move(draft, each, 0.15 + 0.6 * draft.chance.amount, ("moved",))
    return f"the {called(leaf, len(group))} moved"


def resized(draft: Draft) -> str:
    """Make the core, the length or the size of one flow larger or smaller."""
    leaf = draft.pick()
    if leaf is None:
        return ""
    names = [
        p.name
        for p in leaf.document.parameters
        if p.positive and p.form in ("number", "constant") and p.name not in ("amount", "period")
    ]
    if not names:
        return ""
    name = draft.chance.random.choice(names)
    default = next(p for p in leaf.document.parameters if p.name == name).default_in_file
    up = draft.chance.happens(0.5)
    width = 0.25 + 1.2 * draft.chance.amount * draft.chance.random.uniform(0.4, 1.0)
    factor = 1.0 + width if up else 1.0 / (1.0 + width)
    if leaf.name in ("lorenz", "chen", "rossler", "halvorsen", "thomas", "aizawa", "chua"):
        factor **= 0.4  # the attractor must meet the subject
    group = draft.group(leaf)
    for each in group:
        each.values[name] = scaled(each.values.get(name, default), factor)
    return described(leaf, "wider" if up else "narrower", len(group))


def retimed(draft: Draft) -> str:
    """Let everything come earlier or later: keys between the first and the last move."""
    chance = draft.chance
    spans = [times for leaf in draft.leaves() for value in leaf.values.values() if (times := times_of(value))]
    if not any(len(times) > 2 for times in spans):
        return ""
    first, last = min(times[0] for times in spans), max(times[-1] for times in spans)
    bend = chance.spread(0.25 + 0.8 * chance.amount)
    _warp(draft, lambda t: first + (last - first) * _bent((t - first) / max(1, last - first), bend))
    return "a late surge" if bend > 0 else "an early surge"


def staggered(draft: Draft) -> str:
    """Let one flow, also one of a pair, begin later or end sooner than the others."""
    chance = draft.chance
    leaves = [leaf for leaf in draft.leaves() if any(map(times_of, leaf.values.values()))]
    leaves = [leaf for leaf in leaves if leaf.name != "translation"]
    if len(leaves) < 2:
        return ""
    leaf = chance.random.choice(leaves)
    later = chance.happens(0.5)
    share = 0.12 + 0.5 * chance.amount * chance.random.uniform(0.3, 1.0)
    for name, value in leaf.values.items():
        if times := times_of(value):
            first, last = times[0], times[-1]
            push = share * (last - first)
            ends = (first + push, last) if later else (first, last - push)
            leaf.values[name] = _at(
                value, [ends[0] + (t - first) / max(1, last - first) * (ends[1] - ends[0]) for t in times]
            )
    return f"a {called(leaf)} that {'starts late' if later else 'ends early'}"


def eased(draft: Draft) -> str:
    """Give the keys of one flow another easing."""
    leaf = draft.pick()
    ease = draft.chance.random.choice(EASINGS)
    done, group = False, draft.group(leaf) if leaf else []
    for each in group:
        for name, value in each.values.items():
            if isinstance(value, dict) and "keys" in value and value.get("ease", EASINGS[0]) != ease:
                each.values[name] = {"ease": ease, **{k: v for k, v in value.items() if k != "ease"}}
                done = True
    return f"another easing of the {called(leaf, len(group))}" if done and leaf else ""


def reseeded(draft: Draft) -> str:
    """Give turbulence another seed."""
    leaves = [leaf for leaf in draft.leaves() if any(p.name == "seed" for p in leaf.document.parameters)]
    for leaf in leaves:
        leaf.values["seed"] = draft.chance.random.randrange(1, 1000)
    return f"another {called(leaves[0])}" if leaves else ""


def added(draft: Draft) -> str:
    """Add a flow of the palette, in time with the others."""
    flows = draft.data.setdefault("flows", [])
    count = sum(len(each) for each in flow_lists(draft.data))
    if count >= 4 or len(draft.leaves()) >= 7:
        return ""
    rows = palette()
    present = {leaf.name for leaf in draft.leaves()}
    names = [name for name in rows if rows[name]["weight"] and name not in present]
    name = draft.chance.random.choices(names, [rows[name]["weight"] for name in names])[0]
    entry = {name: _new_values(draft, name)}
    if rows[name]["family"] != "deformation" and draft.chance.happens(0.5):
        sums = [item["sum"] for item in flows if "sum" in item]
        if sums:
            sums[0].append(entry)
            return f"{rows[name]['words']} added"
    last = next((index for index, item in enumerate(flows) if item.keys() & {*CARRYING}), len(flows))
    place = last if draft.chance.happens(0.7) else 0
    flows.insert(place, entry)
    return f"{rows[name]['words']} added"


def dropped(draft: Draft) -> str:
    """Leave out a flow, where others remain."""
    leaves = [leaf for leaf in draft.leaves() if leaf.name != "translation"]
    before = {leaf.name for flows in flow_lists(draft.parent.data) for leaf in leaves_of(flows)}
    old = [leaf for leaf in leaves if leaf.name in before]
    if len(leaves) < 2 or not old:
        return ""
    leaf = draft.chance.random.choice(old)
    group = draft.group(leaf) if draft.chance.happens(0.4) else [leaf]
    if len(group) == len(leaves):
        group = [leaf]
    for each in sorted(group, key=lambda item: -item.index):
        del each.holder[each.index]
    _prune(draft)
    if any(each.name == leaf.name for each in draft.leaves()):
        return f"one {called(leaf)} less"
    words = palette().get(leaf.name, {}).get("words", called(leaf))
    draft.words[:] = [each for each in draft.words if called(leaf) not in each and words not in each]
    return f"no {called(leaf)}"


def exchanged(draft: Draft) -> str:
    """Exchange a flow for another one of its family, at its place and in its time."""
    rows, leaf = palette(), draft.pick()
    row = rows.get(leaf.name) if leaf else None
    if leaf is None or row is None:
        return ""
    kin = [name for name in rows if rows[name]["family"] == row["family"] and name != leaf.name]
    name = draft.chance.random.choice(kin)
    group = draft.group(leaf)
    for each in group:
        values = _new_values(draft, name)
        for shared in ("axis", "centre", "direction", "radius"):
            own = {p.name for p in FLOW_DOCUMENTS[name].parameters}
            if shared in each.values and shared in own and row["family"] != "attractor":
                values[shared] = each.values[shared]
        if "direction" in values and values["direction"] == values.get("axis"):
            values["direction"] = "y" if values["axis"] == "x" else "x"
        _take_curve(each, row, values, rows[name])
        each.holder[each.index] = {name: values}
    return f"{rows[name]['words']} for {'each' if len(group) > 1 else 'the'} {called(leaf)}"


def mirrored(draft: Draft) -> str:
    """Let a flow under `sum` act on both sides of a plane."""
    sums = [item["sum"] for flows in flow_lists(draft.data) for item in flows if "sum" in item]
    fields = [
        flow for each in sums for flow in each if next(iter(flow)) not in (*COMPOSITIONS, "translation")
    ]
    if not fields or len(draft.leaves()) > 5:
        return ""
    flow = draft.chance.random.choice(fields)
    holder = next(each for each in sums if flow in each)
    axis = draft.chance.random.choice(["x", "z", "x"])
    holder.append({"mirrored": {"normal": axis, "flows": [copy.deepcopy(flow)]}})
    return f"the {next(iter(flow)).replace('_', ' ')} mirrored"


def bounded(draft: Draft) -> str:
    """Let one entry act on one half of the subject only, with a soft border."""
    flows = draft.data.get("flows") or []
    fitting = [index for index, item in enumerate(flows) if not item.keys() & {"within", "become", *CARRYING}]
    if not fitting:
        return ""
    index, chance = draft.chance.random.choice(fitting), draft.chance
    axis, sign = chance.random.choice([("y", 1), ("y", -1), ("x", 1), ("z", 1)])
    centre, normal = [rounded(v) for v in draft.parent.middle], [int(-sign * v) for v in AXES[axis]]
    region = {
        "half_space": {"centre": centre, "normal": normal},
        "falloff": rounded(draft.parent.half * chance.random.uniform(0.7, 1.4)),
    }
    names = [leaf.name for leaf in leaves_of([flows[index]]) if leaf.name != "translation"]
    flows[index] = {"within": {"region": region, "flows": [flows[index]]}}
    side = {("y", 1): "upper", ("y", -1): "lower", ("x", 1): "right", ("z", 1): "front"}[axis, sign]
    kind = "vortices" if set(names) == {"vortex"} else "flows"
    kind = names[0].replace("_", " ") if len(names) == 1 else kind
    return f"the {kind} on the {side} half"


MOTION: dict[Idea, float] = {
    stronger: 2.0,
    reversed_strength: 0.7,
    tilted: 1.8,
    moved: 1.5,
    resized: 1.2,
    retimed: 0.6,
    staggered: 0.9,
    eased: 0.3,
    reseeded: 0.6,
    added: 2.2,
    dropped: 0.7,
    exchanged: 1.3,
    mirrored: 0.5,
    bounded: 0.5,
}
"""Mutations of the motion, and how often each is tried against the others."""


def _form(leaf: Leaf, name: str) -> tuple[str, bool]:
    found = next((p for p in leaf.document.parameters if p.name == name), None)
    return ("other", False) if found is None else (found.form, found.positive)


def _has_axis(leaf: Leaf) -> bool:
    return any(p.name == "axis" for p in leaf.document.parameters)


def _axis(leaf: Leaf) -> Any:
    default = next(p for p in leaf.document.parameters if p.name == "axis").default_in_file
    return leaf.values.get("axis", default)


def _first(value: Any) -> float | None:
    """Return the first number of a value, which tells equal ones from others."""
    return next(map(abs, _numbers(value)), None)


def _scale_strength(leaf: Leaf, name: str, factor: float) -> None:
    """Multiply a strength; that of a stretch, which is 1 at rest, on a logarithmic scale."""
    if leaf.name == "stretch":
        power = factor**0.7
        leaf.values[name] = mapped(leaf.values[name], lambda v, _: min(3.2, max(0.35, v**power)))
    else:
        leaf.values[name] = scaled(leaf.values[name], factor)


def _move(draft: Draft, leaf: Leaf, width: float, kind: tuple[str, ...] = ()) -> None:
    """Move the centre of a flow; coordinates of equal size move alike, so mirror images stay."""
    chance, half, middle = draft.chance, draft.parent.half, draft.parent.middle

    def change(value: float, axis: int) -> float:
        size = abs(value)
        key = ("place", *kind, leaf.name, axis, rounded(size))
        if size < 1e-6:
            wide = (
                0.5 * width * half
                if chance.shared((*key, "free"), lambda: float(chance.happens(0.35)))
                else 0.0
            )
            moved = chance.shared(key, lambda: chance.spread(wide))
            return 0.0 if abs(moved) < 0.02 * half else moved
        moved = value * chance.shared(key, lambda: chance.factor(1.3 * width))
        return min(max(moved, middle[axis] - FARTHEST * half), middle[axis] + FARTHEST * half)

    leaf.values["centre"] = mapped(leaf.values["centre"], change)


def _bent(share: float, bend: float) -> float:
    """Return a share of the time bent to later (above 0) or earlier; 0 and 1 stay."""
    return share ** (2.0 ** (-2.0 * bend)) if share > 0 else 0.0


def _warp(draft: Draft, change: Callable[[float], float]) -> None:
    """Move the keys of all flows."""
    for leaf in draft.leaves():
        for name, value in leaf.values.items():
            if times := times_of(value):
                leaf.values[name] = _at(value, [change(t) for t in times])


def _at(value: dict[str, Any], times: list[float]) -> dict[str, Any]:
    """Return a value with its keys at times, on whole frames that ascend; as it is where they do not fit."""
    whole = [round(time) for time in times]
    old = times_of(value) or ()
    if (
        len(set(whole)) < len(whole)
        or whole != sorted(whole)
        or min(whole) < min(old)
        or max(whole) > max(old)
    ):
        return value
    return at_times(value, tuple(whole))


def _new_values(draft: Draft, name: str) -> dict[str, Any]:
    """Return values of a flow of the palette that suit the subject and the shot."""
    chance, parent, row = draft.chance, draft.parent, palette()[name]
    parameters = {p.name: p for p in FLOW_DOCUMENTS[name].parameters}
    values: dict[str, Any] = {}
    if "axis" in parameters:
        named = chance.happens(0.65)
        values["axis"] = chance.random.choice("xyyz") if named else [round(v, 2) for v in chance.direction()]
    if "direction" in parameters:
        values["direction"] = next(a for a in chance.random.sample("xyz", 3) if a != values["axis"])
        if isinstance(values["axis"], list):
            values["axis"] = chance.random.choice([a for a in "xyz" if a != values["direction"]])
    if "centre" in parameters:
        deforms = row["family"] == "deformation"
        wide = (0.25 if deforms else 0.55) * parent.half
        middle = parent.middle
        values["centre"] = [
            rounded(round(m + chance.spread(wide) * (not deforms or k == 1), 3)) for k, m in enumerate(middle)
        ]
    for parameter, value in row["values"].items():
        scaled = parameters[parameter].doc.unit == "units" and is_number(value)
        values[parameter] = rounded(value * parent.half * chance.factor(0.25)) if scaled else value
    if "seed" in parameters:
        values["seed"] = chance.random.randrange(1, 1000)
    ((strength, usual),) = row["strength"].items()
    values[strength] = _curve(draft, name, usual * _scale(draft, name))
    return values


def _scale(draft: Draft, name: str) -> float:
    """Return the strength that suits the size of the subject and the duration, over that of the palette."""
    row = palette()[name]
    (strength,) = row["strength"]
    unit = next(p for p in FLOW_DOCUMENTS[name].parameters if p.name == strength).doc.unit
    scale = draft.parent.half ** EXPONENTS.get(unit, 0)
    if row["family"] == "deformation":
        return float(scale)
    return float(scale * min(4.0, max(0.25, USUAL_SECONDS / (0.8 * draft.parent.seconds))))


def _curve(draft: Draft, name: str, value: float) -> dict[str, Any]:
    """Return keys of a new flow: from rest to a value, and back for velocities."""
    chance, parent, row = draft.chance, draft.parent, palette()[name]
    rest = row.get("rest", 0)
    if rest:
        factor = chance.factor(0.3)
        strength = (1.0 / value if chance.happens(0.3) else value) ** factor
    else:
        strength = (
            value
            * chance.factor(0.35)
            * (-1.0 if name not in ("curl_noise", "source") and chance.happens(0.5) else 1.0)
        )
    span = parent.last - parent.first
    shares = [0.04, 0.96] if row["family"] == "deformation" else [0.05, 0.3, 0.68, 0.95]
    late = max(0.0, chance.spread(0.25)) if chance.happens(0.5) else 0.0
    times = [round(parent.first + span * (late + share * (1.0 - late))) for share in shares]
    values = (
        [rest, rounded(strength)] if len(shares) == 2 else [rest, rounded(strength), rounded(strength), rest]
    )
    if len(set(times)) < len(times):
        return {"keys": {parent.first: rest, parent.last: rounded(strength)}}
    return {"keys": dict(zip(times, values, strict=True))}


def _take_curve(leaf: Leaf, row: dict[str, Any], values: dict[str, Any], new: dict[str, Any]) -> None:
    """Give a new flow the course of the strength that the old one had, at its own usual strength."""
    ((old_name, old_usual),), ((name, usual),) = row["strength"].items(), new["strength"].items()
    course = leaf.values.get(old_name)
    if course is None:
        return
    rest, old_rest = new.get("rest", 0), row.get("rest", 0)
    peak = max((abs(v) for v in _numbers(values[name])), default=usual) if not rest else usual
    factor = (peak - rest) / (old_usual - old_rest)
    if not rest and not old_rest:
        old_peak = max((abs(v) for v in _numbers(course)), default=old_usual) or old_usual
        factor = peak / old_peak
    values[name] = mapped(
        course,
        lambda v, _: min(3.2, max(0.35, rest + (v - old_rest) * factor)) if rest else (v - old_rest) * factor,
    )


def _numbers(value: Any) -> list[float]:
    found: list[float] = []

    def note(number: float, _: int) -> float:
        found.append(number)
        return number

    mapped(value, note)
    return found


def _prune(draft: Draft) -> None:
    """Take out compositions that hold nothing any more."""

    def kept(flows: list[Any]) -> list[Any]:
        return [item for item in flows if _holds(item)]

    def _holds(item: dict[str, Any]) -> bool:
        ((name, value),) = item.items()
        if name not in COMPOSITIONS:
            return True
        inner = value if isinstance(value, list) else value["flows"]
        inner[:] = kept(inner)
        return bool(inner)

    for flows in flow_lists(draft.data):
        flows[:] = kept(flows)

"""Crossing: one shot made of two, with the form of one, flows of both, and the picture of either.

Where both parents have the same flow at the same place, as siblings do, its numbers come from one, from the
other, or lie between them. A flow from the other parent is fitted to the size of the subject and the length
of the shot.
"""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

from flowsculpt.api.shots import is_number
from flowsculpt.pipeline.plugins.breed.flow_mutations import Draft
from flowsculpt.pipeline.plugins.breed.gene_values import Chance, at_times, mapped, rounded, times_of
from flowsculpt.pipeline.plugins.breed.shot_genome import Genome, leaves_of

MOST_ENTRIES = 4
"""Entries under `flows` of a child."""

MOST_TITLES = 3
"""Titles of ancestors that the title of a child names."""

ALIKE = 1.2
"""Ratio of the sizes of two subjects up to which flows are taken as they are."""

RATES = ("strength", "rate", "speed", "flux", "time_scale", "inflow", "a", "b", "c")
"""Parameters that are a rate: they act for longer in a longer shot."""


def crossed(first: Genome, second: Genome, chance: Chance, folder: Path) -> Draft:
    """Return a draft with the subject and the frames of the first parent, and the rest of either."""
    data, other = first.rebased(folder), second.rebased(folder)
    words = [f"the form of {_called(first)}"]
    flows = _flows(first, second, data.get("flows") or [], other.get("flows") or [], chance)
    if flows:
        data["flows"] = flows
    if "subjects" not in data and "subjects" not in other and chance.happens(0.6):
        _take(data, other, ("look", "stage", "lights"), words, f"the look of {_called(second)}")
    elif chance.happens(0.5):
        _take(data, other, ("stage", "lights"), words, f"the light of {_called(second)}")
    if chance.happens(0.3) and "camera" in other:
        camera = copy.deepcopy(other["camera"])
        data["camera"] = {name: _retime(value, second, first) for name, value in camera.items()}
    titles = [part for each in (first, second) for part in str(each.data["title"]).split(" × ")]
    data["title"] = " × ".join(list(dict.fromkeys(titles))[:MOST_TITLES])
    return Draft(first, data, chance, words)


def _called(genome: Genome) -> str:
    """Return the name of a shot; of a bred one, whose name is long, its number in its generation."""
    return f"number {genome.name.rpartition('_')[2]}" if genome.ancestry else genome.name


def _take(
    data: dict[str, Any], other: dict[str, Any], names: tuple[str, ...], words: list[str], said: str
) -> None:
    """Take entries of the other parent, or leave them out where it has none."""
    for name in names:
        data.pop(name, None)
        if name in other:
            data[name] = copy.deepcopy(other[name])
    words.append(said)


def _flows(first: Genome, second: Genome, ours: list[Any], theirs: list[Any], chance: Chance) -> list[Any]:
    """Return flows of both: those at the same place blended where they are alike, else of one of the two."""
    result: list[Any] = []
    foreign = 0
    for index in range(max(len(ours), len(theirs))):
        mine = ours[index] if index < len(ours) else None
        own = theirs[index] if index < len(theirs) else None
        if mine is not None and own is not None and _form(mine) == _form(own):
            result.append(_blend(mine, own, chance))
            foreign += 1
        elif own is None or (mine is not None and chance.happens(0.5)):
            if own is not None or chance.happens(0.75):
                result.append(copy.deepcopy(mine))
        else:
            result.append(_fit(own, second, first))
            foreign += 1
    if not foreign and theirs:
        result.append(_fit(chance.random.choice(theirs), second, first))
    if foreign == len(result) and ours and not any(_form(flow) in map(_form, ours) for flow in result):
        result.insert(0, copy.deepcopy(chance.random.choice(ours)))
    return [flow for flow in result if flow][:MOST_ENTRIES]


def _form(value: Any) -> Any:
    """Return what two values must have in common to be blended: names, and lengths of lists."""
    if isinstance(value, dict):
        return tuple((name, _form(item)) for name, item in value.items() if name not in ("keys", "ease"))
    if isinstance(value, list):
        return tuple(_form(item) if isinstance(item, dict) else "" for item in value)
    return ""


def _blend(mine: Any, own: Any, chance: Chance) -> Any:
    """Return a value of one of the two, or between both where they have the same keys."""
    if isinstance(mine, dict) and isinstance(own, dict):
        before, after = times_of(mine), times_of(own)
        if before and after and len(before) == len(after):
            share = chance.shared(("share", *before, *after), lambda: _share(chance))
            times = [round(a + share * (b - a)) for a, b in zip(before, after, strict=True)]
            pairs = zip(mine["keys"].values(), own["keys"].values(), strict=True)
            values = [_blend(a, b, chance) for a, b in pairs]
            return {**mine, "keys": dict(zip(times, values, strict=True))}
        if mine.keys() == own.keys():
            return {name: _blend(mine[name], own[name], chance) for name in mine}
        return copy.deepcopy(mine if chance.happens(0.5) else own)
    if isinstance(mine, list) and isinstance(own, list) and len(mine) == len(own):
        return [_blend(a, b, chance) for a, b in zip(mine, own, strict=True)]
    if is_number(mine) and is_number(own) and isinstance(mine, bool) == isinstance(own, bool):
        share = chance.shared(("share", mine, own), lambda: _share(chance))
        return rounded(mine + share * (own - mine)) if mine != own else mine
    return copy.deepcopy(mine if chance.happens(0.5) else own)


def _share(chance: Chance) -> float:
    """Return how far a value is from the first parent's towards the second's."""
    return float(chance.random.choice((0.0, 1.0, chance.random.uniform(0.2, 0.8))))


def _fit(flow: Any, source: Genome, target: Genome) -> Any:
    """Return a flow of another shot, fitted to the size, the place and the length of this one."""
    flow = copy.deepcopy(flow)
    longer = source.seconds / target.seconds
    for leaf in leaves_of([flow]):
        for name, value in leaf.values.items():
            if name in RATES and not 0.8 < longer < 1.25:
                value = mapped(value, lambda v, _: v * longer)
            leaf.values[name] = _retime(value, source, target)
        numbers = leaf.values.get("with")
        if isinstance(numbers, dict):
            leaf.values["with"] = {word: _retime(value, source, target) for word, value in numbers.items()}
    size = target.half / source.half
    shift = [rounded(b - size * a) for a, b in zip(source.middle, target.middle, strict=True)]
    if 1.0 / ALIKE < size < ALIKE and max(map(abs, shift)) < 0.25 * target.half:
        return flow
    return {"placed": {"translate": shift, "scale": rounded(size), "flows": [flow]}}


def _retime(value: Any, source: Genome, target: Genome) -> Any:
    """Return a value with its keys at the same share of another shot."""
    times = times_of(value)
    if not times:
        return value
    scale = (target.last - target.first) / max(1, source.last - source.first)
    new = tuple(
        min(target.last, max(target.first, round(target.first + (t - source.first) * scale))) for t in times
    )
    if len(set(new)) < len(new):
        return next(iter(value["keys"].values()))
    return at_times(value, new)

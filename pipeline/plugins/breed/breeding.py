"""Children of one shot, or of two that are crossed: each an ordinary shot that validates.

A child is decided by its parents, the seed, its number and the amount of change, and by nothing else.
"""

from __future__ import annotations

import copy
import hashlib
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flowsculpt import FlowsculptError
from flowsculpt.api.shots import Shot, read_shot
from flowsculpt.pipeline.plugins.breed.crossing import crossed
from flowsculpt.pipeline.plugins.breed.flow_mutations import MOTION, Draft, Idea, drift
from flowsculpt.pipeline.plugins.breed.gene_values import Chance
from flowsculpt.pipeline.plugins.breed.picture_mutations import FORM, PICTURE
from flowsculpt.pipeline.plugins.breed.shot_genome import Genome, text_of_shot

MOST_ATTEMPTS = 30
"""Drafts of one child that are tried; the first that validates is taken."""

MOST_WORDS = 4
"""Changes that an intent names."""


@dataclass(frozen=True)
class Litter:
    """The parents and settings that decide the children of a generation.

    parents     one or two
    change      0 to 1: how far children go from their parents
    folder      where their files will be, to which file names are relative
    """

    parents: tuple[Genome, ...]
    seed: int
    change: float
    folder: Path
    allow_code: bool = False

    @property
    def generation(self) -> int:
        """Return 1 for children of shots that were not bred, and one more than their parents' for others."""
        return 1 + max(int(parent.ancestry.get("generation", 0)) for parent in self.parents)

    @property
    def digest(self) -> str:
        """A digest of all that decides the children."""
        parents = [(parent.name, text_of_shot(parent.data), parent.digests) for parent in self.parents]
        return hashlib.sha256(repr((parents, self.seed, self.change)).encode()).hexdigest()


@dataclass(frozen=True)
class Child:
    """A candidate: its number, text, shot, and the changes in words."""

    number: int
    text: str
    shot: Shot
    words: tuple[str, ...]


def child_of(litter: Litter, number: int, name: str) -> Child | None:
    """Return the child with a number, or None where no draft of it validates.

    name  of its shot
    """
    for attempt in range(MOST_ATTEMPTS):
        draft = _draft(litter, number, attempt)
        data = {**draft.data, "intent": _intent(litter, draft.words), "breed": _ancestry(litter, number)}
        text = text_of_shot(data)
        path = litter.folder / f"{name}.yaml"
        try:
            shot = read_shot(path, text, beside={}, allow_code=litter.allow_code)
            return Child(number, text, shot, tuple(dict.fromkeys(draft.words)))
        except FlowsculptError:
            continue  # two changes may not go together: another draft
    return None


def _draft(litter: Litter, number: int, attempt: int) -> Draft:
    chance = Chance(random.Random(f"{litter.seed}:{litter.generation}:{number}:{attempt}"), litter.change)
    if len(litter.parents) == 2:
        first, second = litter.parents if chance.happens(0.5) else litter.parents[::-1]
        draft = crossed(first, second, chance, litter.folder)
        count = 1 + int(chance.happens(2.0 * litter.change))
    else:
        parent = litter.parents[0]
        draft = Draft(parent, parent.rebased(litter.folder), chance)
        count = 2 + int(chance.happens(0.3 + litter.change)) + int(chance.happens(litter.change))
    draft.data = copy.deepcopy(draft.data)
    draft.data.pop("breed", None)
    drift(draft)
    _apply(draft, _plan(chance, count))
    return draft


def _plan(chance: Chance, count: int) -> list[Mapping[Idea, float]]:
    """Return the tables that changes are drawn from: always motion, sometimes form and picture."""
    tables: list[Mapping[Idea, float]] = [MOTION] * max(1, count - 1)
    if chance.happens(0.4):
        tables.append(FORM)
    if chance.happens(0.75):
        tables.append(PICTURE)
    return tables if len(tables) > 1 else [MOTION, PICTURE]


def _apply(draft: Draft, tables: Sequence[Mapping[Idea, float]]) -> None:
    """Apply one change of each table: the first of some tries that applies and was not made before."""
    done: set[Idea] = set()
    for table in tables:
        for _ in range(8):
            idea = draft.chance.random.choices(list(table), list(table.values()))[0]
            if idea not in done and (words := idea(draft)):
                done.add(idea)
                draft.words.append(words)
                break


def _intent(litter: Litter, words: Sequence[str]) -> str:
    """Return what a child shows, in a sentence."""
    names = [parent.name for parent in litter.parents]
    beginning = " crossed with ".join(names)
    shown = list(dict.fromkeys(words))[:MOST_WORDS]
    with_words = [
        word for word in shown if not word.startswith(("in ", "on ", "under ", "seen ", "scattered "))
    ]
    others = [word for word in shown if word not in with_words]
    listed = " and ".join([", ".join(with_words[:-1]), with_words[-1]] if len(with_words) > 1 else with_words)
    joint = ": " if len(names) > 1 else " with "
    return ", ".join([f"{beginning}{joint}{listed}" if listed else beginning, *others]) + "."


def _ancestry(litter: Litter, number: int) -> dict[str, Any]:
    before = [
        name
        for p in litter.parents
        for name in (*p.ancestry.get("ancestors", ()), *p.ancestry.get("parents", ()))
    ]
    return {
        "ancestry": {
            "parents": [parent.name for parent in litter.parents],
            "ancestors": list(dict.fromkeys(before)),
            "generation": litter.generation,
            "candidate": number,
            "seed": litter.seed,
            "change": litter.change,
        }
    }

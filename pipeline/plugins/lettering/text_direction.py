"""The order in which a line of text is set: runs of one direction and one script, from left to right.

Directions are those of the Unicode Bidirectional Algorithm (UAX 9, revision 50), without explicit embeddings,
overrides and isolates. Numbers of its rules are in brackets.
"""

from __future__ import annotations

import unicodedata
from typing import NamedTuple

from fontTools.unicodedata import Mirrored, script

from pipeline.errors import UsageError

EXPLICIT = ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI")
NEUTRAL = ("B", "S", "WS", "ON", "BN")
STRONG = {"L": "L", "R": "R", "EN": "R", "AN": "R"}
"""Directions that neutral characters take from their neighbours (N1)."""

MOST_OPEN = 63
"""Brackets within each other whose pairs are found (BD16)."""


class TextRun(NamedTuple):
    """Characters of a line from `start` to before `end`, set in one direction."""

    start: int
    end: int
    is_leftwards: bool


def visual_runs(line: str) -> list[TextRun]:
    """Return the runs of a line from left to right.

    Raises UsageError for a control of direction, such as U+202E.
    """
    levels = embedding_levels(line)
    scripts = _scripts(line)
    runs: list[tuple[int, TextRun]] = []
    for i, level in enumerate(levels):
        if runs and runs[-1][0] == level and scripts[i] == scripts[i - 1]:
            runs[-1] = level, runs[-1][1]._replace(end=i + 1)
        else:
            runs.append((level, TextRun(i, i + 1, level % 2 == 1)))
    for level in range(max(levels, default=0), 0, -1):  # [L2]
        i = 0
        while i < len(runs):
            j = i
            while j < len(runs) and runs[j][0] >= level:
                j += 1
            runs[i:j] = runs[i:j][::-1]
            i = max(j, i + 1)
    return [run for _, run in runs]


def embedding_levels(line: str) -> list[int]:
    """Return the level of each character: even ones are set rightwards, odd ones leftwards."""
    given = [unicodedata.bidirectional(character) or "L" for character in line]
    if control := next((c for c, kind in zip(line, given, strict=True) if kind in EXPLICIT), None):
        raise UsageError(f"the text has U+{ord(control):04X}, a control of direction. Leave it out.")
    base = next((int(kind != "L") for kind in given if kind in ("L", "R", "AL")), 0)  # [P2, P3]
    outer = "LR"[base]
    kinds = _with_strong_neutrals(line, _with_strong_numbers(given, outer), outer)
    levels = [base + ((kind != "L") if base == 0 else (kind != "R")) for kind in kinds]  # [I1, I2]
    if base == 0:
        levels = [2 if kind in ("EN", "AN") else level for kind, level in zip(kinds, levels, strict=True)]
    for i in range(len(line) - 1, -1, -1):  # [L1]
        if given[i] not in ("WS", "BN", "S", "B"):
            break
        levels[i] = base
    return [base if kind in ("S", "B") else level for kind, level in zip(given, levels, strict=True)]


def _with_strong_numbers(given: list[str], outer: str) -> list[str]:
    """Resolve marks, numbers and their separators [W1 to W7]."""
    kinds = list(given)
    strong = before = outer
    for i, kind in enumerate(kinds):
        if kind in ("NSM", "BN"):
            kinds[i] = before if kind == "NSM" else kind  # [W1]
        elif kind == "EN" and strong == "AL":
            kinds[i] = "AN"  # [W2]
        if kind in ("L", "R", "AL"):
            strong = kind
        before = kinds[i] if kind != "BN" else before
    kinds = ["R" if kind == "AL" else kind for kind in kinds]  # [W3]
    for i in range(1, len(kinds) - 1):  # [W4]
        before, after = kinds[i - 1], kinds[i + 1]
        if before == after and (
            (kinds[i] in ("ES", "CS") and before == "EN") or (kinds[i] == "CS" and before == "AN")
        ):
            kinds[i] = before
    _spread(kinds, "ET", "EN")  # [W5]
    kinds = ["ON" if kind in ("ES", "ET", "CS") else kind for kind in kinds]  # [W6]
    strong = outer
    for i, kind in enumerate(kinds):  # [W7]
        strong = kind if kind in ("L", "R") else strong
        kinds[i] = "L" if kind == "EN" and strong == "L" else kind
    return kinds


def _spread(kinds: list[str], weak: str, number: str) -> None:
    """Turn sequences of a weak kind beside a number into numbers."""
    for order in (range(1, len(kinds)), range(len(kinds) - 2, -1, -1)):
        for i in order:
            neighbour = kinds[i - 1 if order.step == 1 else i + 1]
            if kinds[i] == weak and neighbour == number:
                kinds[i] = number


def _with_strong_neutrals(line: str, kinds: list[str], outer: str) -> list[str]:
    """Resolve brackets by what is between them, and other neutrals by their neighbours [N0 to N2]."""
    for opened, closed in _bracket_pairs(line, kinds):
        inside = {STRONG[kind] for kind in kinds[opened + 1 : closed] if kind in STRONG}
        if outer in inside:
            kinds[opened] = kinds[closed] = outer
        elif inside:
            before = next((STRONG[kind] for kind in kinds[:opened][::-1] if kind in STRONG), outer)
            kinds[opened] = kinds[closed] = before
    i = 0
    while i < len(kinds):
        j = i
        while j < len(kinds) and kinds[j] in NEUTRAL:
            j += 1
        before = STRONG[kinds[i - 1]] if i else outer
        after = STRONG[kinds[j]] if j < len(kinds) else outer
        kinds[i:j] = [before if before == after else outer] * (j - i)
        i = j + 1
    return kinds


def _bracket_pairs(line: str, kinds: list[str]) -> list[tuple[int, int]]:
    """Return the places of paired brackets, by those of the opening ones [BD16]."""
    pairs: list[tuple[int, int]] = []
    waiting: list[tuple[str, int]] = []
    for i, character in enumerate(line):
        if kinds[i] != "ON":
            continue
        bracket = unicodedata.normalize("NFD", character)
        form = unicodedata.category(character)
        if form == "Ps" and ord(bracket) in Mirrored.MIRRORED:
            if len(waiting) == MOST_OPEN:
                return []
            waiting.append((chr(Mirrored.MIRRORED[ord(bracket)]), i))
        elif form == "Pe":
            for depth in range(len(waiting) - 1, -1, -1):
                if waiting[depth][0] == bracket:
                    pairs.append((waiting[depth][1], i))
                    del waiting[depth:]
                    break
    return sorted(pairs)


def _scripts(line: str) -> list[str]:
    """Return the script of each character; those of all scripts have that of their neighbours."""
    found = [script(character) for character in line]
    for order in (range(1, len(found)), range(len(found) - 2, -1, -1)):
        for i in order:
            if found[i] in ("Zyyy", "Zinh", "Zzzz"):
                found[i] = found[i - 1 if order.step == 1 else i + 1]
    return found

"""The order in which a line of text is set: runs of one direction and one script, from left to right.

Directions are those of the Unicode Bidirectional Algorithm (UAX 9, revision 50), without explicit embeddings,
overrides and isolates. Numbers of its rules are in brackets.
"""

from __future__ import annotations

import re
import unicodedata
from typing import NamedTuple

from fontTools.unicodedata import Mirrored, script

from flowsculpt import UsageError

KINDS = {"AL": "A", "EN": "E", "AN": "N", "ES": "+", "ET": "%", "CS": ",", "NSM": "M", "L": "L", "R": "R"}
"""One letter for each bidirectional class; o stands for the neutral ones."""

EXPLICIT = ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI")
STRONG = {"L": "L", "R": "R", "E": "R", "N": "R"}
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
    kinds = _resolve(line, "".join(KINDS.get(kind, "o") for kind in given), "LR"[base])
    steps = {"L": (0, 1), "R": (1, 0), "E": (2, 1), "N": (2, 1)}  # [I1, I2]
    trailing = len(line) - len(line.rstrip())  # [L1]
    levels = [base + steps[kind][base] for kind in kinds[: len(line) - trailing]] + [base] * trailing
    return [base if kind in ("S", "B") else level for kind, level in zip(given, levels, strict=True)]


def _resolve(line: str, kinds: str, outer: str) -> str:
    """Return L, R, E or N for each character, by the kinds of all; `outer` is the direction of the line."""
    kinds = outer + kinds
    kinds = re.sub(r"(.)(M+)", lambda m: m[1] * (1 + len(m[2])), kinds)  # [W1]
    kinds = re.sub(r"A[^LR]*", lambda m: m[0].replace("E", "N"), kinds).replace("A", "R")  # [W2, W3]
    kinds = re.sub(r"(?<=E)[+,](?=E)", "E", re.sub(r"(?<=N),(?=N)", "N", kinds))  # [W4]
    kinds = re.sub(r"%*E[E%]*", lambda m: "E" * len(m[0]), kinds)  # [W5]
    kinds = re.sub(r"[+%,]", "o", kinds)  # [W6]
    kinds = re.sub(r"L[^R]*", lambda m: m[0].replace("E", "L"), kinds)  # [W7]
    resolved = list(kinds)
    for opened, closed in _bracket_pairs(line, kinds[1:]):  # [N0]
        inside = {STRONG[kind] for kind in resolved[opened + 2 : closed + 1] if kind in STRONG}
        before = next(STRONG[kind] for kind in resolved[opened::-1] if kind in STRONG)
        if inside:
            resolved[opened + 1] = resolved[closed + 1] = outer if outer in inside else before

    def neutral(match: re.Match[str]) -> str:  # [N1, N2]
        before, after = STRONG[match[1]], STRONG[match[3]]
        return match[1] + (before if before == after else outer) * len(match[2])

    return re.sub(r"([LREN])(o+)(?=([LREN]))", neutral, "".join(resolved) + outer)[1:-1]


def _bracket_pairs(line: str, kinds: str) -> list[tuple[int, int]]:
    """Return the places of paired brackets, by those of the opening ones [BD16]."""
    pairs: list[tuple[int, int]] = []
    waiting: list[tuple[str, int]] = []
    for i, character in enumerate(line):
        if kinds[i] != "o":
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

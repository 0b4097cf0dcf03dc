"""Nouns in messages, with counts and articles."""

from __future__ import annotations


def plural(count: int, noun: str, nouns: str = "") -> str:
    """Return a count and its noun: `1 frame`, `3 frames`.

    nouns  an irregular plural, such as `vertices`
    """
    return f"{count} {noun}" if count == 1 else f"{count} {nouns or noun + 's'}"


def indefinite(noun: str) -> str:
    """Return a noun with its indefinite article: `a box`, `an icosphere`."""
    return f"{'an' if noun[:1].lower() in 'aeiou' else 'a'} {noun}"

"""Whether the message about a mistake names what is right, for the tables of mistakes."""

from __future__ import annotations

import re
from typing import Any


def words(text: str) -> set[str]:
    """Return the names and values in a text, and the parts of paths."""
    found = re.findall(r"[\w#][\w.:/%-]*[\w%]|\w", text)
    return {part for word in found for part in (word, *word.split("."))}


def is_named(row: dict[str, Any], message: str) -> bool:
    """Tell whether a message names a word that is right and not written, or the key whose value is wrong."""
    right = row.get("right", "")
    new, named = words(right) - words(row["write"]), words(message)
    if new & named:
        return True
    if not any(re.match(r"[A-Za-z_]", word) for word in new):  # another number, or another form
        return bool(words(row["write"]) & named)
    key = re.match(r"(?:\d+:\d+: )?([\w.]+): (?!unknown name)", message)
    return key is not None and key[1].split(".")[-1] in re.findall(r"\w+(?=:|\b.*=)", right)

"""Words of other programs and of English, and what a shot calls them; `synonyms.toml` lists them."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable
from functools import cache
from pathlib import Path


def as_name(word: object) -> str:
    """Return a word as shot files spell names: `focalLength` and `Focal length` are focal_length."""
    text = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", str(word))
    return re.sub(r"[\s-]+", "_", text.strip()).lower()


def synonym(word: object, names: Iterable[str]) -> str | None:
    """Return which of the names a word means; None for words that mean none of them."""
    return _meant(word, names, "names")


def value_meant(word: object, values: Iterable[str]) -> str | None:
    """Return which of the values a word means; None for words that mean none of them."""
    return _meant(word, values, "values")


@cache
def _tables() -> dict[str, dict[str, str]]:
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))


def _meant(word: object, names: Iterable[str], table: str) -> str | None:
    known, spelt = tuple(names), as_name(word)
    if spelt in known:
        return spelt
    of_plugins = (name for name in known if name.endswith(f".{spelt}"))
    meant = (name for name, words in _tables()[table].items() if name in known and spelt in words.split())
    return next(of_plugins, next(meant, None))

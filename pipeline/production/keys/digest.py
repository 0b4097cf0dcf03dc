"""Keys: what a file was made from, as a short hash.

A key is the SHA-256 of canonical JSON (sorted names, shortest round-trip numbers), cut to 128 bits.
Two files with the same key hold the same content, wherever and whenever they were made; what does not
change the content (a comment, the order of a YAML mapping, a file's time) must stay out of it.
"""

from __future__ import annotations

import hashlib
import json
from typing import Any

Key = str

_CANONICAL = json.JSONEncoder(sort_keys=True, separators=(",", ":"), allow_nan=False)


def key_of(*parts: Any) -> Key:
    """The key of plain data: None, bool, int, float, str, lists, tuples and mappings of these.

    Raises TypeError for anything else, and ValueError for NaN or infinity, which JSON cannot say.
    """
    return hashlib.sha256(_CANONICAL.encode(parts).encode()).hexdigest()[:32]

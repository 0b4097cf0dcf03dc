"""Mesh files that end before their content does: what they promise, and how much of it is there."""

from __future__ import annotations

from render.base.plural import plural

_STL_HEADER, _STL_TRIANGLE = 84, 50
"""Bytes of a binary STL: the header with the number of triangles, and each triangle."""

MOST_TRIANGLES = 500_000_000
"""More triangles in the header of an STL are no number of triangles."""


def early_end(promised: int, item: str, present: int) -> ValueError:
    """Return the error of a file whose header promises more items than there are."""
    there = f"{present} {'is' if present == 1 else 'are'} there"
    count = plural(promised, item, "vertices" if item == "vertex" else "")
    return ValueError(f"it ends early: its header promises {count}, and {there}")


def check_stl(data: bytes) -> None:
    """Raise ValueError for the bytes of an STL, as text or binary, that end before the last triangle."""
    if data[:1024].lstrip().startswith(b"solid") and (b"facet" in data[:1024] or len(data) < _STL_HEADER):
        if b"endsolid" not in data[-1024:]:
            present = data.count(b"endfacet")
            raise ValueError(f"it ends early: endsolid is missing after {plural(present, 'triangle')}")
        return
    if len(data) < _STL_HEADER:
        raise ValueError(f"it ends early: it has {plural(len(data), 'byte')}, and its header alone needs 84")
    promised = int.from_bytes(data[80:84], "little")
    present = (len(data) - _STL_HEADER) // _STL_TRIANGLE
    if promised > MOST_TRIANGLES:
        raise ValueError("it has no STL header")
    if present < promised:
        raise early_end(promised, "triangle", present)


def check_glb(data: bytes) -> None:
    """Raise ValueError for the bytes of a GLB that are fewer than its header tells."""
    if data[:4] != b"glTF":
        raise ValueError("it has no GLB header")
    promised = int.from_bytes(data[8:12], "little")
    if len(data) < max(promised, 12):
        raise early_end(max(promised, 12), "byte", len(data))

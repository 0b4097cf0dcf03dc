"""Keys: the same content, the same key; anything else, another."""

import math
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.production.keys import digest
from pipeline.production.keys.digest import (
    FINISH_CODE,
    FRAMING_CODE,
    MOVIE_CODE,
    NORMALS_CODE,
    PICTURE_CODE,
    SIMULATION_CODE,
    code_key,
    key_of,
)

plain = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.text(), plain, max_size=5))
def test_the_order_of_a_mapping_is_no_content(data):
    assert key_of(data) == key_of(dict(reversed(data.items())))


@given(plain, plain)
def test_parts_do_not_run_into_one_another(a, b):
    assert key_of([a, b]) != key_of(a, b)


def test_the_last_bit_of_a_number_is_content():
    assert key_of(0.05) != key_of(math.nextafter(0.05, 1))


def test_what_json_cannot_say_is_refused():
    with pytest.raises(ValueError):
        key_of(math.nan)
    with pytest.raises(TypeError):
        key_of(object())


@pytest.mark.parametrize(
    "sources", [SIMULATION_CODE, NORMALS_CODE, FRAMING_CODE, PICTURE_CODE, FINISH_CODE, MOVIE_CODE]
)
def test_every_source_a_key_names_is_there(sources):
    assert len(code_key(sources)) == 32


STANDS_BESIDE = {
    "pipeline.arrays",
    "pipeline.errors",
    "pipeline.mesh._kernels_patches",
    "pipeline.mesh.bspline",
    "pipeline.mesh.pn_triangles",
    "pipeline.mesh.io.write",
    "pipeline.shot",
    *(
        f"pipeline.shot.{name}"
        for name in (
            "adaptive",
            "brackets",
            "inline",
            "materials",
            "camera_document",
            "cameras",
            "catalogue",
            "checks",
            "compositions",
            "curves",
            "data",
            "documents",
            "edits",
            "field_documents",
            "fields",
            "film",
            "flows",
            "formulas",
            "generated",
            "keys",
            "layers",
            "looks",
            "messages",
            "parse",
            "point_documents",
            "read",
            "regions",
            "sets",
            "settings",
            "shot",
            "shutter",
            "source",
            "smoothing",
            "speed",
            "surroundings",
            "views",
        )
    ),
}
"""What a simulation imports although it changes no mesh: names of types, errors, and what reads shot files,
whose values are in the keys themselves."""


def test_all_that_a_simulation_imports_is_in_its_key_or_known_to_change_no_mesh():
    script = "import sys, pipeline.animation; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    room = Path(digest.__file__).parents[3]

    def in_the_key(module: str) -> bool:
        place = Path(*module.split("."))
        file = place / "__init__.py" if (room / place).is_dir() else place.with_suffix(".py")
        return any(Path(source) in (file, *file.parents) for source in SIMULATION_CODE)

    modules = {name for name in done.stdout.split() if name.split(".")[0] == "pipeline"}
    assert {module for module in modules if not in_the_key(module)} == modules & STANDS_BESIDE


@pytest.mark.parametrize(
    ("edited", "counts"),
    [
        ("formula/words.py", True),
        ("mesh/halfedge.py", True),
        ("resample/polyhedra/slicer.py", True),
        ("resample/quarter.py", True),
        ("shot/clock.py", True),
        ("mesh/write.py", False),
        ("mesh/patches.py", False),
        ("shot/messages.py", False),
        ("cli/files.py", False),
    ],
)
def test_only_an_edit_of_what_moves_vertices_simulates_again(edited, counts, tmp_path, monkeypatch):
    room = Path(digest.__file__).parents[3]
    shutil.copytree(room / "pipeline", tmp_path / "pipeline", ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(digest, "_ROOM", tmp_path)
    before = code_key.__wrapped__(SIMULATION_CODE)
    with (tmp_path / "pipeline" / edited).open("a", encoding="utf-8") as file:
        file.write("# another word\n")
    assert (code_key.__wrapped__(SIMULATION_CODE) != before) == counts

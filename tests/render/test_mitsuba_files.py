"""Mitsuba opens no picture itself: its wheel contains OpenEXR 2.5, whose faults are known to attackers.

Our readers open pictures (`render/scene/picture_file.py`), and Mitsuba gets arrays.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from flowsculpt.render.scene.materials.mitsuba_bsdf import PLUGINS
from tests.needed_plugins import is_of_installed

ROOT = Path(__file__).parents[2]

READERS = {
    *("load_file", "load_string", "xml", "parser", "TensorFile", "VolumeGrid", "Struct", "StructConverter"),
    *("FileStream", "MemoryMappedFile", "MemoryStream", "DummyStream", "ZStream", "Stream"),
}
"""What of Mitsuba reads files."""

PATHS = {"str", "Path", "fspath", "fsdecode", "as_posix", "absolute", "resolve", "open", "format", "join"}
"""Functions whose results name files."""

ALLOWED = {
    "render/mitsuba/bsdf_plugins.py": "a table of a measured material, read in a process of its own before",
    "pipeline/shot/documents/look_documents.py": "the index of a file that is read here, or its name",
}


def faults(tree: ast.AST) -> Iterator[str]:
    """Yield the line of each place where Mitsuba would open a file."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and ast.unparse(node.value) in ("mi", "mitsuba"):
            if node.attr in READERS:
                yield f"{node.lineno}: {ast.unparse(node)}"
        elif isinstance(node, ast.ImportFrom) and node.module == "mitsuba":
            yield from (f"{node.lineno}: {alias.name}" for alias in node.names if alias.name in READERS)
        elif isinstance(node, ast.Dict):
            names = [key.value for key in node.keys if isinstance(key, ast.Constant)]
            yield from (f"{node.lineno}: {name}" for name in names if name == "filename")
        elif isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store):
            if isinstance(node.slice, ast.Constant) and node.slice.value == "filename":
                yield f"{node.lineno}: {ast.unparse(node)}"
        elif isinstance(node, ast.Call):
            if any(each.arg == "filename" for each in node.keywords):
                yield f"{node.lineno}: filename="
            if ast.unparse(node.func).endswith("Bitmap") and not all(map(_is_array, node.args)):
                yield f"{node.lineno}: {ast.unparse(node)}"


def _is_array(argument: ast.expr) -> bool:
    """Tell whether an expression is a call that returns an array. Values of names are unknown: False."""
    if not isinstance(argument, ast.Call):
        return False
    function = argument.func
    return (function.attr if isinstance(function, ast.Attribute) else ast.unparse(function)) not in PATHS


def test_no_source_gives_mitsuba_a_file_to_open() -> None:
    found = {
        path.relative_to(ROOT).as_posix(): list(faults(ast.parse(path.read_text(encoding="utf-8"))))
        for folder in ("flowsculpt", "pipeline", "render")
        for path in (ROOT / folder).rglob("*.py")
    }
    assert len(found) > 250
    assert {name: lines for name, lines in found.items() if lines}.keys() == {
        *filter(is_of_installed, ALLOWED)
    }


def test_materials_written_out_for_mitsuba_name_no_other_files() -> None:
    files = {name for name, plugin in PLUGINS.items() if "file" in plugin.parameters.values()}
    assert files == {"measured", "bitmap"}, "of which our readers read bitmaps"


@pytest.mark.parametrize(
    "source",
    [
        *("mi.Bitmap('sky.exr')", "mi.Bitmap(path)", "mi.Bitmap(str(path))", "mitsuba.Bitmap(self.path)"),
        *("mi.Bitmap(path.as_posix())", "Bitmap(f'{folder}/sky.exr')", "mi.load_file('scene.xml')"),
        *("mi.load_dict({'type': 'envmap', 'filename': path})", "made['filename'] = path"),
        *("mi.load_dict(dict(type='bitmap', filename=path))", "from_file = mi.VolumeGrid"),
        "from mitsuba import load_file",
    ],
)
def test_such_a_source_is_found(source: str) -> None:
    assert list(faults(ast.parse(source)))

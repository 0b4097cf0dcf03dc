"""The zip of the Blender extension: what it says, holds and imports."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.blender.test_extension import built_package

ROOT = Path(__file__).parents[2]

REQUIRED = {
    *("schema_version", "id", "version", "name", "tagline", "maintainer", "type"),
    *("blender_version_min", "license"),
}

BLENDERS = {"bpy", "bpy_extras", "mathutils", "numpy"}


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    return zipfile.ZipFile(built_package(tmp_path_factory.mktemp("dist")))


def test_the_manifest_says_what_blender_asks_and_has_the_version_of_flowsculpt(package) -> None:
    manifest = tomllib.loads(package.read("blender_manifest.toml").decode())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert manifest["version"] == project["version"]
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"], "Blender's store takes no Apache-2.0"
    assert "GNU GENERAL PUBLIC LICENSE" in package.read("LICENSE").decode()[:100]
    assert all(
        package.read(name).startswith(b"# SPDX-License-Identifier: GPL-3.0-or-later\n")
        for name in package.namelist()
        if name.endswith(".py")
    )
    assert manifest["blender_version_min"] == "4.5.0" and manifest["type"] == "add-on"
    assert len(manifest["tagline"]) <= 64 and manifest["tagline"][-1].isalnum(), "Blender's rules"
    assert len(manifest["permissions"]["files"]) <= 64 and manifest["permissions"]["files"][-1].isalnum()
    assert "__init__.py" in package.namelist() and "LICENSE" in package.namelist()


def test_the_manifest_keeps_to_the_schema_of_blender(package) -> None:
    """https://docs.blender.org/manual/en/latest/advanced/extensions/getting_started.html#manifest"""
    manifest = tomllib.loads(package.read("blender_manifest.toml").decode())
    optional = {
        "website",
        "tags",
        "blender_version_max",
        "copyright",
        "permissions",
        "platforms",
        "wheels",
        "build",
    }
    assert manifest.keys() - optional == REQUIRED and manifest["schema_version"] == "1.0.0"
    assert re.fullmatch(r"[a-z][a-z0-9_]*", manifest["id"])
    assert all(re.fullmatch(r"\d+\.\d+\.\d+", manifest[name]) for name in ("version", "blender_version_min"))
    assert set(manifest["tags"]) <= {"Animation", "Import-Export", "Render", "Modeling", "Geometry Nodes"}
    assert manifest["permissions"].keys() <= {"files", "network", "clipboard", "camera", "microphone"}


def test_equal_sources_give_equal_bytes(tmp_path: Path) -> None:
    assert built_package(tmp_path / "one").read_bytes() == built_package(tmp_path / "other").read_bytes()


def test_the_modules_import_only_blender_numpy_the_standard_library_and_each_other(package) -> None:
    names = {Path(name).stem for name in package.namelist()}
    for file in (name for name in package.namelist() if name.endswith(".py")):
        for node in ast.walk(ast.parse(package.read(file))):
            if isinstance(node, ast.ImportFrom) and node.level:
                found = {node.module} if node.module else {alias.name for alias in node.names}
                assert found <= names, file
            elif isinstance(node, ast.ImportFrom | ast.Import):
                found = {node.module} if isinstance(node, ast.ImportFrom) else {a.name for a in node.names}
                assert {name.split(".")[0] for name in found} <= BLENDERS | sys.stdlib_module_names, file

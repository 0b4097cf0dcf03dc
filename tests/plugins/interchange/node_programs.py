"""Programs of npm that check exports, installed under the environment; tests skip where npm cannot be had."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock

PROGRAMS = {"gltf-validator": "2.0.0-dev.3.10", "meshoptimizer": "1.3.0"}

PLACE = Path(sys.prefix) / "node"

_VALIDATE = """
const validator = require('gltf-validator'), fs = require('fs');
const reports = process.argv.slice(1).map(path =>
  validator.validateBytes(new Uint8Array(fs.readFileSync(path)), {maxIssues: 50}));
Promise.all(reports).then(all => console.log(JSON.stringify(all)));
"""


def module(name: str) -> Path:
    """The folder of a program; skips the test where it cannot be installed."""
    if shutil.which("npm") is None or shutil.which("node") is None:
        pytest.skip("no npm")
    there = PLACE / "node_modules" / name
    with FileLock(PLACE.with_suffix(".lock")):
        if not there.exists():
            PLACE.mkdir(exist_ok=True)
            named = [f"{name}@{version}" for name, version in PROGRAMS.items()]
            words = ["npm", "install", "--prefix", str(PLACE), "--no-save", "--no-audit", "--no-fund"]
            done = subprocess.run([*words, "--ignore-scripts", *named], capture_output=True, timeout=120)
            if done.returncode:
                pytest.skip(f"npm: {done.stderr.decode()[-200:]}")
    return there


def gltf_messages(*paths: Path) -> list[dict[str, Any]]:
    """The errors and warnings of the Khronos glTF validator for files."""
    module("gltf-validator")
    ran = subprocess.run(
        ["node", "-e", _VALIDATE, *map(str, paths)], cwd=PLACE, capture_output=True, check=True, timeout=60
    )
    return [
        message
        for report in json.loads(ran.stdout)
        for message in report["issues"]["messages"]
        if message["severity"] < 2
    ]

"""The facade of the package: every public name is there, and none is imported before it is used."""

from __future__ import annotations

import subprocess
import sys

from flowsculpt import render


def test_every_public_name_can_be_imported() -> None:
    assert all(getattr(render, name) is not None for name in render.__all__)
    assert not hasattr(render, "nothing_of_that_name")


def test_importing_the_package_imports_no_renderer() -> None:
    heavy = "('mitsuba', 'numba', 'OpenImageIO')"
    code = f"import sys, flowsculpt.render; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"

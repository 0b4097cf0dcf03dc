# SPDX-License-Identifier: GPL-3.0-or-later
"""Stage and render flow sculptures in Blender: an extension that runs the installed program flowsculpt."""

from __future__ import annotations

import bpy

from . import current_shot, sidebar
from .shot_operators import OPERATORS


def register() -> None:
    """Add operators, panel, preferences and handlers to Blender."""
    sidebar.register()
    for each in OPERATORS:
        bpy.utils.register_class(each)
    current_shot.register()


def unregister() -> None:
    """Remove everything that `register` added, and cancel what is running."""
    current_shot.unregister()
    for each in reversed(OPERATORS):
        bpy.utils.unregister_class(each)
    sidebar.unregister()

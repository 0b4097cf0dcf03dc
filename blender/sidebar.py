# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel in the sidebar of the 3D view, the settings of a scene, and the preferences of the extension."""

import shutil
import textwrap
from collections.abc import Iterable
from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, IntProperty, PointerProperty, StringProperty

from .current_shot import PACKAGE, current, is_busy, preferences
from .exported_films import FILM
from .program import ProgramError
from .shot_operators import QUALITIES, progress_words
from .shown_shot import shots_in

LINE = 40  # characters of a line of a message in the panel

NO_PROGRAM = (
    "To edit and render shots, install the program flowsculpt (pipx install flowsculpt[film]), or give its "
    "path in the preferences."
)


def _shots(settings: bpy.types.PropertyGroup, context: bpy.types.Context, text: str) -> Iterable[str]:
    """Return the shots of the show, for the search of the field."""
    try:
        return shots_in(Path(bpy.path.abspath(settings.folder)))
    except ProgramError:
        return ()


class FlowsculptSettings(bpy.types.PropertyGroup):
    folder: StringProperty(name="Show", subtype="DIR_PATH", description="The folder that holds shots")
    shot: StringProperty(name="Shot", search=_shots, description="The name of a shot in shots")
    writes: BoolProperty(
        name="Write Edits",
        default=True,
        description="Write moved empties and keys into the shot file at once",
    )
    simulates: BoolProperty(
        name="Simulate", default=True, description="Simulate what an edit changes, in the background"
    )
    quality: EnumProperty(name="Quality", items=QUALITIES)
    whole: BoolProperty(name="All Frames", default=False, description="Render all frames, not only this one")


class FlowsculptPreferences(bpy.types.AddonPreferences):
    bl_idname = PACKAGE

    program: StringProperty(
        name="flowsculpt", subtype="FILE_PATH", description="The program; empty for the one on PATH"
    )
    memory: IntProperty(
        name="Memory for Frames (MiB)", default=2048, min=64, description="Frames beyond this are read again"
    )

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.prop(self, "program")
        self.layout.prop(self, "memory")


def _draw_message(layout: bpy.types.UILayout, message: str) -> None:
    for index, line in enumerate(textwrap.wrap(message, LINE)):
        layout.label(text=line, icon="BLANK1" if index else "ERROR")


class ShotPanel(bpy.types.Panel):
    bl_idname = "FLOWSCULPT_PT_shot"
    bl_label = "Flowsculpt"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Flowsculpt"

    def draw(self, context: bpy.types.Context) -> None:
        layout, settings, shot = self.layout, context.scene.flowsculpt, current.shot
        for film in (
            each[FILM] for each in bpy.data.collections if FILM in each and not Path(each[FILM]).is_file()
        ):
            _draw_message(layout, f"{film} is not there any more. Open it where it is now.")
        layout.operator("flowsculpt.open_film", icon="FILE_FOLDER")
        if shutil.which(preferences().program or "flowsculpt") is None:
            _draw_message(layout, NO_PROGRAM)
            return
        layout.prop(settings, "folder")
        layout.prop(settings, "shot")
        row = layout.row(align=True)
        row.operator("flowsculpt.open")
        if shot is None:
            layout.operator("flowsculpt.subject_from_mesh")
            return
        row.operator("flowsculpt.close", text="", icon="X")
        layout.label(text=shot.listing["title"])
        layout.label(text=f"{shot.simulated()} of {len(shot.numbers)} frames simulated")
        if is_busy():
            row = layout.row(align=True)
            at = current.runs[-1].progress
            row.progress(text=progress_words(), factor=at["done"] / at["total"] if at else 0.0)
            row.operator("flowsculpt.cancel", text="", icon="CANCEL")
        else:
            layout.operator("flowsculpt.make")
        _draw_message(layout, shot.message)
        row = layout.row()
        row.prop(settings, "writes")
        row.prop(settings, "simulates")
        layout.operator("flowsculpt.write")
        layout.operator("flowsculpt.camera_to_shot", icon="CAMERA_DATA")
        box = layout.column(align=True)
        row = box.row(align=True)
        row.prop(settings, "quality", text="")
        row.prop(settings, "whole", toggle=True)
        box.operator("flowsculpt.render", icon="RENDER_STILL")
        layout.operator_menu_enum("flowsculpt.use_in_scene", "form")
        layout.operator("flowsculpt.subject_from_mesh")


CLASSES = (FlowsculptSettings, FlowsculptPreferences, ShotPanel)


def register() -> None:
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.flowsculpt = PointerProperty(type=FlowsculptSettings)


def unregister() -> None:
    del bpy.types.Scene.flowsculpt
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)

# SPDX-License-Identifier: GPL-3.0-or-later
"""The shot that is open now, and the handlers that follow frame changes, undo and new files."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from .program import ProgramError, Run
from .shown_shot import ShownShot

PACKAGE = __package__

TICK = 0.25  # seconds between checks for edits

LOADING = 4  # frames loaded ahead at each check


class _Current:
    """The open shot, if any, the runs that are going on, and the edits that were seen last."""

    shot: ShownShot | None = None
    seen: list[object] | None = None

    def __init__(self) -> None:
        self.runs: list[Run] = []


current = _Current()


def require_shot() -> ShownShot:
    """Return the open shot. Raises ProgramError where none is open."""
    if current.shot is None:
        raise ProgramError("No shot is open. Choose a show and a shot in the sidebar, and open it")
    return current.shot


def preferences() -> bpy.types.AddonPreferences:
    return bpy.context.preferences.addons[PACKAGE].preferences


@persistent
def _frame_changed(scene: bpy.types.Scene, *_: object) -> None:
    if current.shot is not None:
        current.shot.show_frame(scene)


@persistent
def _undone(scene: bpy.types.Scene, *_: object) -> None:
    """Show the shot as it is now: an undo step brings back former meshes and cameras.

    Steps before the shot was read bring back empties of another reading, which must not be written.
    """
    if current.shot is not None and current.shot.is_there():
        current.shot.take_listing(current.shot.listing, scene)
    else:
        current.shot = None


@persistent
def _file_loaded(*_: object) -> None:
    """Forget the open shot and its runs: Blender ends their operators when it opens another file."""
    cancel_runs()
    current.runs.clear()
    current.shot = current.seen = None


def _look() -> float:
    """Write edits that have come to rest, and load frames ahead."""
    shot, windows = current.shot, bpy.context.window_manager.windows
    if shot is None or not windows:
        return TICK
    scene = windows[0].scene
    for _ in range(LOADING):
        shot.load_ahead(scene, preferences().memory * 2**20)
    if not scene.flowsculpt.writes or is_busy("edit"):
        return TICK
    try:
        changed = shot.changed()
    except ProgramError as error:
        shot.message = str(error)  # an empty was deleted; it stays so, and one message is enough
        return TICK
    seen = [(slot.words, slot.snapshot()) for slot in changed]
    if changed and seen == current.seen and not _is_dragging(windows[0]):
        try:
            with bpy.context.temp_override(window=windows[0]):
                bpy.ops.flowsculpt.write("INVOKE_DEFAULT")
        except RuntimeError as error:  # the operator's report, which Blender shows nowhere after a timer
            _pop_up(str(error).removeprefix("Error: "))
    current.seen = seen
    return TICK


def _pop_up(message: str) -> None:
    """Show a message at the pointer."""
    if not bpy.app.background:
        bpy.context.window_manager.popup_menu(
            lambda menu, context: menu.layout.label(text=message.strip()), title="Flowsculpt", icon="ERROR"
        )


def _is_dragging(window: bpy.types.Window) -> bool:
    """Tell whether the artist is in the middle of a move; our own operators wait for runs."""
    return any(not operator.bl_idname.startswith("FLOWSCULPT") for operator in window.modal_operators)


def is_busy(command: str = "") -> bool:
    """Tell whether a run is going on, of one command or any."""
    return any(command in ("", run.words[0]) for run in current.runs)


def cancel_runs() -> None:
    """Cancel all runs of flowsculpt."""
    for run in current.runs:
        run.cancel()


def replace_simulation() -> None:
    """End a simulation, since another one takes its place; renders go on."""
    for run in current.runs:
        if run.words[0] == "frames" and "-q" not in run.words:
            run.cancel(is_replaced=True)


HANDLERS = (
    ("frame_change_pre", _frame_changed),
    ("undo_post", _undone),
    ("redo_post", _undone),
    ("load_post", _file_loaded),
)


def register() -> None:
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).append(handler)
    bpy.app.timers.register(_look, first_interval=TICK, persistent=True)


def unregister() -> None:
    _file_loaded()
    if bpy.app.timers.is_registered(_look):
        bpy.app.timers.unregister(_look)
    for name, handler in HANDLERS:
        getattr(bpy.app.handlers, name).remove(handler)

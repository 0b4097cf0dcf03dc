# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators of the sidebar. Long ones run flowsculpt in the background and report when it is over."""

import time
from pathlib import Path

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from .current_shot import cancel_runs, current, preferences, replace_simulation, require_shot
from .exported_films import SUFFIXES, import_file, open_film
from .program import Answer, ProgramError, Run, find_program
from .shown_shot import ShownShot, remove_objects, shots_in

POLL = 0.2  # seconds between looks at a run

QUALITIES = [(name, name, "") for name in ("draft", "daily", "final")]


class _Reporting:
    """Reports errors as the operator's own, and keeps the message for the panel."""

    def refused(self, error: ProgramError) -> set[str]:
        if current.shot is not None:
            current.shot.message = str(error)
        self.report({"ERROR"}, str(error))
        return {"CANCELLED"}


class _Running(_Reporting):
    """An operator that runs flowsculpt: in the background, or in scripts until it is over.

    `begin` starts the run, `done` takes its answer, `failed` an error; each may raise ProgramError.
    `_shot` was open when the run began; another one may be open when it ends.
    """

    def begin(self, context: bpy.types.Context) -> Run:
        raise NotImplementedError

    def done(self, context: bpy.types.Context, answer: Answer) -> None:
        raise NotImplementedError

    def failed(self, context: bpy.types.Context, error: ProgramError) -> None:
        """Take back what the run was to do."""

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self._start(context)
        except ProgramError as error:
            return self.refused(error)
        while not self._run.is_over:
            self._follow(context)
            time.sleep(POLL / 4)
        return self._finish(context)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background or context.window is None:
            return self.execute(context)
        try:
            self._start(context)
        except ProgramError as error:
            return self.refused(error)
        self._timer = context.window_manager.event_timer_add(POLL, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        self._follow(context)
        context.workspace.status_text_set(progress_words())
        for area in context.window.screen.areas:
            area.tag_redraw()
        if not self._run.is_over:
            return {"PASS_THROUGH"}
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)
        return self._finish(context)

    def _start(self, context: bpy.types.Context) -> None:
        self._run, self._shot = self.begin(context), current.shot
        current.runs.append(self._run)

    def _follow(self, context: bpy.types.Context) -> None:
        """Take new answers; a frame that was simulated is shown."""
        for step in self._run.new_steps():
            if current.shot is not None and step["stage"] == "simulate":
                current.shot.show_frame(context.scene)

    def _finish(self, context: bpy.types.Context) -> set[str]:
        current.runs.remove(self._run)
        try:
            answer = self._run.result()
            if current.shot is not None:
                current.shot.message = ""
            self.done(context, answer)
        except ProgramError as error:
            if self._run.is_replaced:
                return {"CANCELLED"}
            return self._undo_and_report(context, error)
        except RuntimeError as error:  # the report of an operator that `done` has called
            return self.refused(ProgramError(str(error).removeprefix("Error: ").strip()))
        return {"FINISHED"}

    def _undo_and_report(self, context: bpy.types.Context, error: ProgramError) -> set[str]:
        """Take back what the run was to do, and report its error, or what goes wrong on the way."""
        try:
            self.failed(context, error)
        except ProgramError as another:
            error = another
        return self.refused(error)


def progress_words() -> str:
    """Return what the latest run is doing: `simulating: 12 of 58 frames`."""
    if not current.runs:
        return ""
    at, command = current.runs[-1].progress, current.runs[-1].words[0]
    if at is None:
        return {"edit": "Writing the shot …", "export": "Exporting …"}.get(command, "Planning …")
    return f"{at['doing']}: {at['done']} of {at['total']} frames"


class OpenShot(_Reporting, bpy.types.Operator):
    bl_idname = "flowsculpt.open"
    bl_label = "Open Shot"
    bl_description = "Show the sculpture, flows and camera of the shot; what was open is closed"
    bl_options = {"REGISTER", "UNDO"}  # else undoing the first move would remove the shot

    def execute(self, context: bpy.types.Context) -> set[str]:
        wanted = context.scene.flowsculpt
        try:
            folder = Path(bpy.path.abspath(wanted.folder) if wanted.folder else "").absolute()
            names = shots_in(folder)
            program = find_program(preferences().program)
            wanted.shot = wanted.shot if wanted.shot in names else names[0]
            shot = ShownShot.read(program, folder, wanted.shot)
        except ProgramError as error:
            return self.refused(error)
        replace_simulation()
        current.shot = shot
        shot.build(context.scene)
        if wanted.simulates and not bpy.app.background:
            bpy.ops.flowsculpt.make("INVOKE_DEFAULT")
        return {"FINISHED"}


class CloseShot(bpy.types.Operator):
    bl_idname = "flowsculpt.close"
    bl_label = "Close Shot"
    bl_description = "Remove the shot's objects from the scene; its files stay"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        cancel_runs()
        current.shot = None
        remove_objects(context.scene)
        return {"FINISHED"}


class MakeFrames(_Running, bpy.types.Operator):
    bl_idname = "flowsculpt.make"
    bl_label = "Simulate Missing Frames"
    bl_description = "Simulate the frames that are not in the store, and frame the camera"

    simulate: BoolProperty(default=True, options={"SKIP_SAVE"})

    def begin(self, context: bpy.types.Context) -> Run:
        shot = require_shot()
        replace_simulation()
        make = ["--make", "--wait"] if self.simulate else []
        return Run(shot.program, ["frames", shot.name, *make], shot.folder)

    def done(self, context: bpy.types.Context, answer: Answer) -> None:
        if current.shot is self._shot:
            self._shot.take_listing(answer, context.scene)
        _require_whole(answer)


def _require_whole(answer: Answer) -> None:
    """Raise ProgramError with the first frame that failed."""
    for failure in answer.get("failed", [])[:1]:
        raise ProgramError(f"{failure['shot']} frame {failure['frame']}: {failure['message']}")


class CancelRun(bpy.types.Operator):
    bl_idname = "flowsculpt.cancel"
    bl_label = "Cancel"
    bl_description = "End what flowsculpt is doing; what is done stays done"

    def execute(self, context: bpy.types.Context) -> set[str]:
        cancel_runs()
        return {"FINISHED"}


class _Editing(_Running):
    """An operator that edits the shot file and shows what it changes."""

    def begin(self, context: bpy.types.Context) -> Run:
        shot = require_shot()
        edits = self.edits(context, shot)
        replace_simulation()
        return Run(shot.program, ["edit", shot.name], shot.folder, shot.request(edits))

    def edits(self, context: bpy.types.Context, shot: ShownShot) -> list[Answer]:
        raise NotImplementedError

    def done(self, context: bpy.types.Context, answer: Answer) -> None:
        if current.shot is not self._shot:
            return
        self._shot.take_state(answer, self._snapshots)
        if bpy.app.background:
            bpy.ops.flowsculpt.make(simulate=False)
        else:
            bpy.ops.flowsculpt.make("INVOKE_DEFAULT", simulate=context.scene.flowsculpt.simulates)

    def failed(self, context: bpy.types.Context, error: ProgramError) -> None:
        shot = self._shot
        if current.shot is not shot:
            return
        if not error.changed:
            shot.revert(list(self._snapshots))
            return
        try:
            current.shot = ShownShot.read(shot.program, shot.folder, shot.name)
            current.shot.build(context.scene)
        except ProgramError as broken:
            raise ProgramError(f"{error} It cannot be shown: {broken}") from None


class WriteEdits(_Editing, bpy.types.Operator):
    bl_idname = "flowsculpt.write"
    bl_label = "Write to Shot"
    bl_description = "Write moved empties and edited keys into the shot file"

    def edits(self, context: bpy.types.Context, shot: ShownShot) -> list[Answer]:
        changed = shot.changed()
        self._snapshots = {slot: slot.snapshot() for slot in changed}
        try:
            found = shot.edits_of(changed)
        except ProgramError:
            shot.revert(changed)
            raise
        if not found:
            raise ProgramError("Nothing to write: all flows are as in the shot file")
        return found


class CameraToShot(_Editing, bpy.types.Operator):
    bl_idname = "flowsculpt.camera_to_shot"
    bl_label = "Camera to Shot"
    bl_description = "Write position, direction and lens of the scene's camera into the shot file"

    def edits(self, context: bpy.types.Context, shot: ShownShot) -> list[Answer]:
        self._snapshots = {}
        if context.scene.camera is None:
            raise ProgramError("The scene has no camera. Add one, or choose one in the scene's properties")
        return shot.camera_edits(context.scene.camera, context.scene)


class SubjectFromMesh(_Running, bpy.types.Operator):
    bl_idname = "flowsculpt.subject_from_mesh"
    bl_label = "New Shot of Selected Mesh"
    bl_description = "Export the active mesh into the show's models and begin a shot with it"
    bl_options = {"REGISTER", "UNDO"}

    shot: StringProperty(name="Shot", description="Name of the new shot", default="A010_mine")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if bpy.app.background:
            return self.execute(context)
        return context.window_manager.invoke_props_dialog(self)

    def begin(self, context: bpy.types.Context) -> Run:
        wanted, shape = context.scene.flowsculpt, context.active_object
        folder = Path(bpy.path.abspath(wanted.folder) if wanted.folder else "").absolute()
        if not (folder / "shots").is_dir():
            raise ProgramError(f"{folder}: it has no folder shots. Choose the folder of a show")
        if shape is None or shape.type != "MESH" or not shape.select_get():
            raise ProgramError("No mesh is selected. Select the object that flows")
        program = find_program(preferences().program)
        self._model = file = folder / "shots" / "models" / f"{bpy.path.clean_name(shape.name)}.obj"
        if file.exists():
            raise ProgramError(f"{file}: exists already, and other shots may use it. Rename the object")
        others = [each for each in context.selected_objects if each != shape]
        for each in others:
            each.select_set(False)
        try:
            file.parent.mkdir(exist_ok=True)
            bpy.ops.wm.obj_export(
                filepath=str(file), export_selected_objects=True, apply_modifiers=True, path_mode="COPY"
            )
        except (OSError, RuntimeError) as error:
            raise ProgramError(f"{file}: Blender cannot export the mesh: {error}") from None
        finally:
            for each in others:
                each.select_set(True)
        words = ["new", self.shot, "--model", str(file.relative_to(folder)), "--json"]
        return Run(program, words, folder)

    def done(self, context: bpy.types.Context, answer: Answer) -> None:
        for remark in answer.get("remarks", []):
            self.report({"INFO"}, remark)
        context.scene.flowsculpt.shot = self.shot
        bpy.ops.flowsculpt.open()

    def failed(self, context: bpy.types.Context, error: ProgramError) -> None:
        """Remove the model where no shot was written, so that another name can be tried."""
        if not self._run.was_cancelled:
            self._model.unlink(missing_ok=True)


class RenderShot(_Running, bpy.types.Operator):
    bl_idname = "flowsculpt.render"
    bl_label = "Render"
    bl_description = "Render frames with flowsculpt; they come back as an image sequence before the camera"
    bl_options = {"REGISTER", "UNDO"}

    def begin(self, context: bpy.types.Context) -> Run:
        shot, wanted = require_shot(), context.scene.flowsculpt
        frames = [] if wanted.whole else ["-f", str(context.scene.frame_current)]
        words = ["frames", shot.name, "--make", "--wait", "-q", wanted.quality, *frames]
        return Run(shot.program, words, shot.folder)

    def done(self, context: bpy.types.Context, answer: Answer) -> None:
        _require_whole(answer)
        rows, shot = [row for row in answer["pictures"] if row["state"] == "done"], self._shot
        image = bpy.data.images.load(rows[0]["file"], check_existing=True)
        image.name, image.source = f"{shot.name} {context.scene.flowsculpt.quality}", "SEQUENCE"
        image.reload()
        camera = bpy.data.objects.get(shot.camera)
        if camera is not None:
            behind = camera.data.background_images
            ours = (each for each in behind if each.image and each.image.name.startswith(f"{shot.name} "))
            picture = next(ours, None) or behind.new()  # an earlier one would cover this one
            picture.image, picture.display_depth = image, "FRONT"
            first, last = rows[0]["frame"], rows[-1]["frame"]
            use = picture.image_user
            use.frame_start, use.frame_duration, use.frame_offset = first, last - first + 1, first - 1
            camera.data.show_background_images = True


class UseInScene(_Running, bpy.types.Operator):
    bl_idname = "flowsculpt.use_in_scene"
    bl_label = "Use in Scene"
    bl_description = "Export the sculpture and link it into the scene, without the shot's empties"
    bl_options = {"REGISTER", "UNDO"}

    form: EnumProperty(
        name="As",
        items=[
            ("abc", "One mesh (Alembic)", "The same triangles in all frames, read from an Alembic file"),
            ("usd", "USD stage", "The meshes of all frames with camera and lights"),
            ("gltf", "One mesh (glTF)", "The same triangles in all frames, as shape keys"),
        ],
    )

    def begin(self, context: bpy.types.Context) -> Run:
        shot = require_shot()
        plain = ["--plain"] if self.form == "gltf" else []  # Blender reads no EXT_meshopt_compression
        return Run(shot.program, ["export", self.form, shot.name, "--json", *plain], shot.folder)

    def done(self, context: bpy.types.Context, answer: Answer) -> None:
        import_file(self._shot.folder / answer["path"])


class OpenFilm(_Reporting, ImportHelper, bpy.types.Operator):
    bl_idname = "flowsculpt.open_film"
    bl_label = "Open an Exported Film…"
    bl_description = "Show what flowsculpt export has written, with its frames and rate; needs no program"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default=";".join(f"*{suffix}" for suffix in SUFFIXES), options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self.report({"INFO"}, open_film(Path(bpy.path.abspath(self.filepath)), context.scene))
        except ProgramError as error:
            return self.refused(error)
        return {"FINISHED"}


OPERATORS = (
    OpenShot,
    CloseShot,
    MakeFrames,
    CancelRun,
    WriteEdits,
    CameraToShot,
    SubjectFromMesh,
    RenderShot,
    UseInScene,
    OpenFilm,
)

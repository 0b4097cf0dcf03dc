"""The command `new`: begin a shot."""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import typer

from flowsculpt import FlowsculptError, FrameError, UsageError
from flowsculpt.api import plugins, plural
from flowsculpt.api.commands import print_result, print_warning, require_one_of
from flowsculpt.api.files import disk_errors
from flowsculpt.api.frames import Show
from flowsculpt.api.options import Common
from flowsculpt.pipeline.plugins.authoring.data_shots import shot_of_data
from flowsculpt.pipeline.plugins.authoring.gallery_shots import GALLERY, gallery_files, gallery_names
from flowsculpt.pipeline.plugins.authoring.new_files import Content, same_contents, write_new
from flowsculpt.pipeline.plugins.authoring.schema_command import SCHEMAS, defaults_of, write_schemas
from flowsculpt.pipeline.plugins.authoring.sequence_shots import shot_of_sequence
from flowsculpt.pipeline.plugins.authoring.shot_schemas import flows
from flowsculpt.pipeline.plugins.authoring.shot_templates import (
    FIRST_SHOT,
    FLOW_FILES,
    SCHEMA,
    SHARED,
    model_template,
    shot_of_flow,
    shot_of_shot,
    show_files,
    without_shared,
)

MODELS = "models"
"""Folder in shots/ for copies of models."""

_SHOT_SCHEMA = SCHEMA.format((SCHEMAS / "shot.json").as_posix())


def new(
    common: Common,
    name: Annotated[
        str | None,
        typer.Argument(
            metavar="NAME|DIR",
            help="The name of the shot, its file and its frames. With --show, the folder; default: this one.",
        ),
    ] = None,
    source: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="FLOW|SHOT",
            help="A flow, with a subject that suits it; or a shot to copy: the name of one here or in the "
            f"gallery, or a path. The gallery has {', '.join(gallery_names())}.",
        ),
    ] = "twist",
    show: Annotated[
        bool, typer.Option("--show", help="Begin a show: a folder with a first shot, defaults and an edit.")
    ] = False,
    gallery: Annotated[
        bool,
        typer.Option("--gallery", help="With --show: the show is the gallery, with all shots and its films."),
    ] = False,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            metavar="FILE",
            help="Show this model: OBJ, PLY, STL, OFF, GLB, FBX, DAE, 3MF or USD. It is fitted, "
            "with edges that suit its detail.",
        ),
    ] = None,
    sequence: Annotated[
        str | None,
        typer.Option(
            "--sequence",
            metavar="FILES",
            help="Show this moving mesh of another program: numbered files, as 'cache/*.ply', or a file with "
            "an animation: Alembic, USD, glTF, FBX, PC2 or MDD.",
        ),
    ] = None,
    data: Annotated[
        Path | None,
        typer.Option(
            "--data",
            metavar="FILE",
            help="Show what the velocities in this file carry along: NetCDF, HDF5, Zarr, VTK grids or .npz; "
            "or in a sequence, as 'wind_*.vti'.",
        ),
    ] = None,
    all_levels: Annotated[
        bool, typer.Option("--all-levels", help="With --data: all depths of a sea, not its surface as a map.")
    ] = False,
) -> None:
    """Begin a shot, or a show: write files that are ready to render.

    `flowsculpt new A020_ring --from vortex_ring` writes shots/A020_ring.yaml; `flowsculpt flows` lists the
    flows. `flowsculpt new A040_mine --from B060_bloom` copies that shot of the gallery, if there is none of
    this name here, with the models and sounds that it names.

    `flowsculpt new --show my_show` writes a folder with shots/A010_first.yaml, shots/defaults.yaml, which all
    its shots share, and the edit shots/film.yaml, so that `flowsculpt film` works there at once. What is in
    the folder already stays as it is. With `--gallery` the shots, models, music and films are those of the
    gallery.

    `flowsculpt new A030_bunny --model bunny.obj` writes a shot of a model under a gentle twist, or under the
    flow that `--from` names. A model outside the project's folder is copied to shots/models; one inside stays
    where it is. It says what had to be repaired.

    `flowsculpt new A050_splash --sequence "cache/*.ply"` writes a shot of numbered files, which stay where
    they are.

    `flowsculpt new A060_ocean --data ocean.nc` writes a shot of what the velocities in a file carry along; it
    proposes seeds, a pace and a camera.

    The schemas by which editors complete and check shot files are written to shots/.schema, and a file that
    the flow reads beside the shot.
    """
    if show:
        given = {"--model": model, "--sequence": sequence, "--data": data}
        if alone := next((option for option, value in given.items() if value is not None), ""):
            raise UsageError(
                f"--show begins a folder and {alone} one shot; begin the show first, then run flowsculpt new "
                f"NAME {alone} FILE in its folder"
            )
        if gallery and source != "twist":
            raise UsageError(f"--gallery brings its shots along; leave --from {source} out")
        _begin_show(common, Path(name or "."), source, gallery)
        return
    if gallery:
        raise UsageError(
            "--gallery begins a show: flowsculpt new --show NAME --gallery; flowsculpt new NAME --from "
            "B060_bloom copies one shot of it"
        )
    if name is None:
        raise UsageError(
            "new needs the name of a shot, as in flowsculpt new A010_mine; "
            "flowsculpt new --show begins a show in this folder"
        )
    if name.endswith((".yaml", ".yml")):
        raise UsageError(f"{name} is the name of a file; write {Path(name).stem}, the name of the shot")
    if fault := Show.name_fault(name):
        raise UsageError(fault)
    path = Show().folder / f"{name}.yaml"
    if path.exists():
        raise UsageError(f"{path} is there already; choose another name or edit that file")
    if all_levels and data is None:
        raise UsageError("--all-levels is for --data FILE; leave it out")
    if sequence is not None or data is not None:
        is_alone = model is None and source == "twist" and (sequence is None or data is None)
        shot = _of_files(sequence, data, name, is_alone, all_levels)
    else:
        shot = _of_source(source, name) if model is None else _of_model(model, source, name)
    files = [path, *shot.beside]
    for file in shot.beside:
        if file.exists():
            raise UsageError(f"{file} is there already, and {source} would write one; choose another name")
    if not common.dry_run:
        with disk_errors(path):
            write_schemas(Show().folder)
            write_new({**shot.beside, path: _SHOT_SCHEMA + shot.text})
    for remark in shot.remarks:
        print_warning(remark)
    written = ", ".join(map(str, files))
    permitted = " --allow-code" if source == "python" else ""
    done = f"{written}: written. Look at it: flowsculpt preview {name}{permitted}"
    facts = {"path": str(path), "files": [str(file) for file in files], "remarks": shot.remarks}
    print_result(f"{written}: would be written." if common.dry_run else done, facts, common.json)


@dataclass(frozen=True)
class _NewShot:
    """The text of a new shot.

    beside   by path, the files beside it
    remarks  what to tell about the model
    """

    text: str
    beside: dict[Path, Content] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)


def _of_source(source: str, name: str) -> _NewShot:
    """Return a new shot of a flow, or the copy of a shot."""
    if source in flows():
        file = FLOW_FILES.get(source)
        text = without_shared(shot_of_flow(source, name), defaults_of(Show().folder))
        return _NewShot(text, {Show().folder / f"{name}{file[0]}": file[1]} if file else {})
    from flowsculpt.api.shots import YamlSource, read_shot  # takes time to import
    from flowsculpt.pipeline.plugins.authoring.shot_copies import CopiedShot, copied_shot, whole_text

    known, of_gallery = Show().shots(), gallery_names()
    if source not in known and not source.endswith((".yaml", ".yml")):
        words = dict.fromkeys((*known, *of_gallery, *flows()))
        require_one_of(source, words, f"{source!r} is neither a flow nor a shot.")
    is_here = source in known or source not in of_gallery
    path, target = (
        Show().find_shot(source) if is_here else GALLERY / f"{source}.yaml",
        Show().folder / f"{name}.yaml",
    )
    try:
        if path.parent.resolve() == Show().folder.resolve():
            text = shot_of_shot(YamlSource.read_text(path), name)
            copy, remarks = CopiedShot(text, text), []
        else:
            files = [file for file, _ in read_shot(path).files]
            stays = path.parent.resolve() != GALLERY
            copy = copied_shot(path, shot_of_shot(whole_text(path), name), files, stays)
            remarks = _about_defaults(target, copy.today, source)
        read_shot(target, copy.today)
    except FlowsculptError as error:
        first = str(error).splitlines()[0]
        raise UsageError(f"a copy of {source} would not be good in {Show().folder}/: {first}") from None
    remedy = "rename it, in shots that name it too"
    beside: dict[Path, Content] = {
        copied: file for copied, file in copy.copies.items() if not same_contents(file, copied, remedy)
    }
    return _NewShot(copy.text, beside, remarks)


def _about_defaults(target: Path, text: str, source: str) -> list[str]:
    """Return a remark about a copy that is not as the shot in another folder, by the defaults of this one."""
    from flowsculpt.api.shots import WrittenShot, read_shot

    alone = WrittenShot.read(target, text, beside={}).source.data
    here = WrittenShot.read(target, text).source.data
    names = ", ".join(name for name, value in here.items() if value != alone.get(name))
    if not names or read_shot(target, text) == read_shot(target, text, beside={}):
        return []
    return [f"{Show().defaults} changes this copy of {source}: {names}; what the shot itself says wins"]


def _of_files(sequence: str | None, data: Path | None, name: str, alone: bool, all_levels: bool) -> _NewShot:
    """Return a new shot of a moving mesh, or of velocities; not `alone` beside a model, a flow or both."""
    if not alone:
        option = "--sequence" if data is None else "--data"
        raise UsageError(f"{option} shows files as they are; leave the other options out")
    if data is not None:
        try:
            text, beside, remarks = shot_of_data(data, name, all_levels)
        except FrameError as error:  # no frame is rendered here
            raise UsageError(str(error)) from None
    else:
        (text, remarks), beside = shot_of_sequence(str(sequence), name), {}
    return _NewShot(without_shared(text, defaults_of(Show().folder)), beside, remarks)


def _of_model(model: Path, source: str, name: str) -> _NewShot:
    """Return a new shot of a model under a flow."""
    if source not in flows():
        remedy = "Leave --from out, or name a flow; in a copy of a shot, write the model into its subject."
        raise UsageError(
            f"--from {source} is not a flow, and --model shows its file under one. "
            f"{plugins().lacking(source) or remedy}"
        )
    beside = dict(_of_source(source, name).beside)
    place = model.resolve()
    is_copy = not place.is_relative_to(Path.cwd().resolve())
    if not is_copy:
        reference = Path(os.path.relpath(place, Show().folder.resolve())).as_posix()
        where = f"{model} stays where it is; the shot names it {reference}"
    else:
        if model.suffix.lower() == ".gltf":
            raise UsageError(
                f"{model}: a glTF names other files, which its copy would miss. Put all of them into a "
                f"folder in {Show().folder}, or export a GLB, which holds them."
            )
        copied = Show().folder / MODELS / model.name
        reference = f"{MODELS}/{model.name}"
        where = f"{model} lies outside this folder; the shot shows its copy {copied}"
        if not same_contents(model, copied):
            beside[copied] = place
    template = model_template(place, reference, is_copy)
    text = without_shared(shot_of_flow(source, name, template), defaults_of(Show().folder))
    return _NewShot(text, beside, [where, *template.notes])


def _begin_show(common: Common, folder: Path, source: str, gallery: bool) -> None:
    """Write the files of a show that are not there yet, and report them and those that stay.

    Raises UsageError for a file that stands in the way of the gallery, before any is written.
    """
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is a file; name the folder of the show, or a new one")
    copies = {folder / name: file for name, file in gallery_files().items()} if gallery else {}
    shots = [*gallery_names()] if gallery else Show(folder / Show().folder).shots()
    files: dict[Path, Content] = {}
    if not shots:
        require_one_of(source, flows(), f"{source!r} is not a flow.")
        shot = _SHOT_SCHEMA + without_shared(shot_of_flow(source, FIRST_SHOT), SHARED)
        if source in FLOW_FILES:
            ending, write = FLOW_FILES[source]
            files[folder / Show().folder / f"{FIRST_SHOT}{ending}"] = write
        files[folder / Show().folder / f"{FIRST_SHOT}.yaml"] = shot
    for name, text in show_files(folder.absolute().name, shots or [FIRST_SHOT]).items():
        if not (gallery and name.endswith(".yaml")):
            files[folder / name] = text
    kept = [path for path in files if path.exists()]
    another = "the gallery needs a folder of its own, so name a new one"
    kept += [path for path, file in copies.items() if same_contents(file, path, another)]
    if gallery and (defaults := folder / Show().defaults) not in copies and defaults.exists():
        raise UsageError(f"{defaults} would change the gallery's shots; {another}")
    files.update(copies)
    written = [path for path in files if path not in kept]
    if not common.dry_run:
        with disk_errors(folder):
            write_new({path: files[path] for path in written})
            write_schemas(folder / Show().folder)
    facts = {
        "folder": str(folder),
        "written": [str(path) for path in written],
        "kept": [str(p) for p in kept],
    }
    lines = [f"{path}: {common.done('written')}" for path in written if path not in copies]
    lines += [f"{path}: kept as it is" for path in kept]
    if count := sum(path in copies for path in written):
        lines.append(
            f"{folder / Show().folder}: {plural(count, 'file')} of the gallery: {common.done('written')}"
        )
    enter = "" if folder.resolve() == Path.cwd() else f"cd {shlex.quote(str(folder))}; "
    lines.append(f"Go on: {enter}flowsculpt preview {(shots or [FIRST_SHOT])[0]}; flowsculpt film")
    print_result("\n".join(lines), facts, common.json)

"""The command `new`: begin a shot."""

from __future__ import annotations

import filecmp
import os
import shlex
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from flowsculpt.pipeline.cli.options import Common, require_one_of
from flowsculpt.pipeline.cli.output import print_result, print_warning
from flowsculpt.pipeline.errors import FlowsculptError, UsageError
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.plugins.authoring.schema_command import (
    SCHEMAS,
    defaults_of,
    write_schemas,
    write_text,
)
from flowsculpt.pipeline.plugins.authoring.shot_copies import CopiedShot, copied_shot
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
from flowsculpt.pipeline.production.request.lookup import FILM, SHOTS, find_shot, shot_names
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.documents.flow_documents import DOCUMENTS
from flowsculpt.pipeline.shot.yaml.named_files import is_edit, name_fault, shot_files, text_of
from flowsculpt.render.base.atomic_write import atomic_write, disk_errors

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
            help="A flow, with a subject that suits it; or the name or path of a shot to copy.",
        ),
    ] = "twist",
    show: Annotated[
        bool, typer.Option("--show", help="Begin a show: a folder with a first shot, defaults and an edit.")
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
) -> None:
    """Begin a shot, or a show: write files that are ready to render.

    `flowsculpt new A020_ring --from vortex_ring` writes shots/A020_ring.yaml; `--from A010_cube` would copy
    that shot. `flowsculpt flows` lists the flows.

    `flowsculpt new --show my_show` writes a folder with shots/A010_first.yaml, shots/defaults.yaml, which all
    its shots share, and the edit shots/film.yaml, so that `flowsculpt film` works there at once. What is in
    the folder already stays as it is.

    `flowsculpt new A030_bunny --model bunny.obj` writes a shot of a model under a gentle twist, or under the
    flow that `--from` names. A model outside the project's folder is copied to shots/models; one inside stays
    where it is. It says what had to be repaired.

    The schemas by which editors complete and check shot files are written to shots/.schema, and a file that
    the flow reads beside the shot.
    """
    if show:
        if model is not None:
            raise UsageError(
                "--show begins a folder and --model one shot; begin the show first, then run flowsculpt new "
                "NAME --model FILE in its folder"
            )
        _begin_show(common, Path(name or "."), source)
        return
    if name is None:
        raise UsageError(
            "new needs the name of a shot, as in flowsculpt new A010_mine; "
            "flowsculpt new --show begins a show in this folder"
        )
    if name.endswith((".yaml", ".yml")):
        raise UsageError(f"{name} is the name of a file; write {Path(name).stem}, the name of the shot")
    if fault := name_fault(name):
        raise UsageError(fault)
    path = SHOTS / f"{name}.yaml"
    if path.exists():
        raise UsageError(f"{path} is there already; choose another name or edit that file")
    shot = _of_source(source, name) if model is None else _of_model(model, source, name)
    files = [path, *shot.beside]
    for file in shot.beside:
        if file.exists():
            raise UsageError(f"{file} is there already, and {source} would write one; choose another name")
    if not common.dry_run:
        with disk_errors(path):
            write_schemas(SHOTS)
            for file, write in shot.beside.items():
                with atomic_write(file) as draft:
                    write(draft)
            write_text(path, _SHOT_SCHEMA + shot.text)
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

    beside   by path, the functions that write files beside it
    remarks  what to tell about the model
    """

    text: str
    beside: dict[Path, Callable[[Path], object]] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)


def _of_source(source: str, name: str) -> _NewShot:
    """Return a new shot of a flow, or the copy of a shot."""
    if source in DOCUMENTS:
        file = FLOW_FILES.get(source)
        text = without_shared(shot_of_flow(source, name), defaults_of(SHOTS))
        return _NewShot(text, {SHOTS / f"{name}{file[0]}": file[1]} if file else {})
    known = shot_names()
    if source not in known and not source.endswith((".yaml", ".yml")):
        require_one_of(source, [*known, *DOCUMENTS], f"{source!r} is neither a flow nor a shot.")
    path = find_shot(source)
    text = shot_of_shot(text_of(path), name)
    copy = CopiedShot(text, text)
    try:
        if path.parent.resolve() != SHOTS.resolve():
            copy = copied_shot(text, path.parent, [file for file, _ in read_shot(path).files])
        read_shot(SHOTS / f"{name}.yaml", copy.today)
    except FlowsculptError as error:
        first = str(error).splitlines()[0]
        raise UsageError(f"a copy of {source} would not be good in {SHOTS}/: {first}") from None
    beside: dict[Path, Callable[[Path], object]] = {
        copied: partial(shutil.copyfile, file)
        for copied, file in copy.copies.items()
        if not _same_contents(file, copied)
    }
    return _NewShot(copy.text, beside)


def _of_model(model: Path, source: str, name: str) -> _NewShot:
    """Return a new shot of a model under a flow."""
    if source not in DOCUMENTS:
        remedy = "Leave --from out, or name a flow; in a copy of a shot, write the model into its subject."
        raise UsageError(
            f"--from {source} is not a flow, and --model shows its file under one. "
            f"{plugins().lacking(source) or remedy}"
        )
    beside = dict(_of_source(source, name).beside)
    place = model.resolve()
    is_copy = not place.is_relative_to(Path.cwd().resolve())
    if not is_copy:
        reference = Path(os.path.relpath(place, SHOTS.resolve())).as_posix()
        where = f"{model} stays where it is; the shot names it {reference}"
    else:
        if model.suffix.lower() == ".gltf":
            raise UsageError(
                f"{model}: a glTF names other files, which its copy would miss. Put all of them into a "
                f"folder in {SHOTS}, or export a GLB, which holds them."
            )
        copied = SHOTS / MODELS / model.name
        reference = f"{MODELS}/{model.name}"
        where = f"{model} lies outside this folder; the shot shows its copy {copied}"
        if not _same_contents(model, copied):
            beside[copied] = partial(shutil.copyfile, place)
    template = model_template(place, reference, is_copy)
    text = without_shared(shot_of_flow(source, name, template), defaults_of(SHOTS))
    return _NewShot(text, beside, [where, *template.notes])


def _same_contents(file: Path, copied: Path) -> bool:
    """Tell whether a copy of a file is there already. Raises UsageError where it has other contents."""
    if not copied.exists():
        return False
    if file.is_file() and not filecmp.cmp(file, copied, shallow=False):
        raise UsageError(f"{copied} is there already with other contents; rename one of the two files")
    return True


def _begin_show(common: Common, folder: Path, source: str) -> None:
    """Write the files of a show that are not there yet, and report them and those that stay."""
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is a file; name the folder of the show, or a new one")
    paths = [path for path in shot_files(folder / SHOTS) if path.name != FILM.name]
    shots = [path.stem for path in paths if not is_edit(path)]
    files: dict[Path, Callable[[Path], Any]] = {}
    for name, text in show_files(folder.absolute().name, shots or [FIRST_SHOT]).items():
        files[folder / name] = partial(write_text, text=text)
    if not shots:
        require_one_of(source, DOCUMENTS, f"{source!r} is not a flow.")
        shot = without_shared(shot_of_flow(source, FIRST_SHOT), SHARED)
        files[folder / SHOTS / f"{FIRST_SHOT}.yaml"] = partial(write_text, text=_SHOT_SCHEMA + shot)
        if source in FLOW_FILES:
            ending, write = FLOW_FILES[source]
            files[folder / SHOTS / f"{FIRST_SHOT}{ending}"] = write
    kept = [path for path in files if path.exists()]
    written = [path for path in files if path not in kept]
    if not common.dry_run:
        with disk_errors(folder):
            (folder / SHOTS).mkdir(parents=True, exist_ok=True)
            for path in written:
                path.parent.mkdir(parents=True, exist_ok=True)
                files[path](path)
            write_schemas(folder / SHOTS)
    facts = {
        "folder": str(folder),
        "written": [str(path) for path in written],
        "kept": [str(p) for p in kept],
    }
    lines = [f"{path}: {common.done('written')}" for path in written]
    lines += [f"{path}: kept as it is" for path in kept]
    enter = "" if folder.resolve() == Path.cwd() else f"cd {shlex.quote(str(folder))}; "
    lines.append(f"Go on: {enter}flowsculpt preview {(shots or [FIRST_SHOT])[0]}; flowsculpt film")
    print_result("\n".join(lines), facts, common.json)

"""The commands `edit` and `frames`, by which other programs show and edit a shot; their answers are JSON.

Every line of standard output is one JSON object. Where a command fails, the last one holds the `error`, which
standard error has too; `changed` then says whether the file was changed by others.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Annotated, Any

import typer

from flowsculpt import FlowsculptError, UsageError
from flowsculpt.api.commands import Project, execute
from flowsculpt.api.frames import FrameStates, PipelineStage, Plan, RenderRequest, Show, Store
from flowsculpt.api.options import DEFAULT_QUALITY, Common, Frames, Shot, ShotOptions, shared_option
from flowsculpt.pipeline.plugins.preview.shot_editor import (
    MOST_REQUEST_BYTES,
    ShotEditor,
    StaleError,
    digest_of,
    edits_in,
    json_object,
)


def edit(common: Common, shot: Shot, options: ShotOptions) -> None:
    """Edit values of a shot file, for programs: reads a request of JSON, and answers with JSON.

    `flowsculpt edit A010_cube` answers the request `{}` with the digest of the file and its values, each with
    its path, form, bounds and keys. A request with that digest and a list of edits changes the file, and is
    answered with its new state: `{"digest": "…", "edits": [{"kind": "set", "where": ["flows", 0, "vortex",
    "radius"], "value": 0.5}]}`. The kind `remove` takes a name out, and `rename` gives it the name `value`,
    such as another time of a key.

    Comments and order stay. Nothing is written if the file has another digest by now, which the answer calls
    `changed`, or if the shot would not be valid. With --dry-run nothing is written at all.
    """
    with _errors_answered():
        editor = ShotEditor(Show().find_shot(shot), tuple(options.settings or ()), options.allow_code)
        asked = json_object(sys.stdin.buffer.read(MOST_REQUEST_BYTES + 1))
        if unknown := asked.keys() - {"digest", "edits"}:
            raise UsageError(f"a request has digest and edits, and no {', '.join(sorted(unknown))}")
        if asked and "digest" not in asked:
            raise UsageError(
                "a request with edits names the digest of the file; the request {} answers with it"
            )
        if not asked:
            _answer(editor.state())
        elif common.dry_run:
            _answer(editor.state_of(editor.trial(str(asked.get("digest")), edits_in(asked.get("edits")))))
        else:
            _answer(editor.edit(str(asked.get("digest")), edits_in(asked.get("edits"))))


def frames(
    common: Common,
    shot: Shot,
    options: ShotOptions,
    frames: Frames = None,
    quality: Annotated[
        str | None, shared_option("quality", "List pictures of this quality too; with --make, render them.")
    ] = None,
    make: Annotated[
        bool, typer.Option("--make", help="Make what is missing first: meshes and cameras, or pictures.")
    ] = False,
) -> None:
    """List the files of a shot's frames, for programs: answers with JSON.

    `flowsculpt frames A010_cube` answers with frames, rate and digest of the shot; with file, key and state
    of each subject's mesh in each frame; and with the camera of each frame, once cameras are framed. The file
    of a mesh lies in the store under its key: it is there once it is simulated, and never changes. An edit
    changes the keys of the frames that it affects.

    `flowsculpt frames A010_cube --make` simulates and frames what is missing first; each line before the last
    says how many frames of a stage are done. `-q draft` lists, or with --make renders, finished frames.
    """
    with _errors_answered():
        project, path = options.project(common), Show().find_shot(shot)
        name, variant = quality or DEFAULT_QUALITY, None if quality else "none"

        def planned() -> Plan:
            if quality is not None:
                return project.pictures([shot], quality, frames)
            return project.geometry(project.request(path, name, frames, variant))

        making = make and not common.dry_run
        outcome = execute(common, planned, teller=_answer_progress) if making else None
        request = project.request(path, name, frames, variant)
        failed = [_failure(event) for event in outcome.failures] if outcome else []
        _answer({**_listing(project, request, quality is not None), "failed": failed})
    raise typer.Exit(outcome.exit_code if outcome else 0)


def _answer_progress(plan: Plan) -> Callable[[dict[str, Any]], None]:
    """Return what answers with a line whenever a frame of a stage is done."""
    totals, done = plan.frame_counts(), dict.fromkeys(PipelineStage.all(), 0)

    def tell(event: dict[str, Any]) -> None:
        stage = str(event.get("stage"))
        if event["event"] == "frame" and totals.get(stage):
            done[stage] += 1
            _answer(
                {"stage": stage, "doing": PipelineStage.all()[stage].doing, "frame": event.get("frame")}
                | {"done": done[stage], "total": totals[stage]}
            )

    return tell


def _failure(event: Mapping[str, Any]) -> dict[str, Any]:
    return {name: event.get(name) for name in ("shot", "stage", "frame", "message")}


def _listing(project: Project, request: RenderRequest, with_pictures: bool) -> dict[str, Any]:
    """Return the files of a request's frames, and the cameras if they are framed."""
    store, numbers, shot = project.store, request.requested, request.shot
    listing = {
        "shot": request.name,
        "title": shot.title,
        "digest": digest_of(request.source.text),
        "first": shot.frames.first,
        "last": shot.frames.last,
        "fps": float(shot.rate.fps),
        "aspect": request.pictures.aspect,
        "subjects": [_meshes(part, store, numbers) for part in request.parts],
        "cameras": _cameras(request, store),
    }
    if with_pictures:
        states = FrameStates.of_pictures(request, store, project.history)
        done = set(states.done)
        files = [(project.root / place).as_posix() for place in request.places("frame", numbers)]
        listing["pictures"] = [
            {"frame": number, "file": file, "state": "done" if number in done else "missing"}
            for number, file in zip(numbers, files, strict=True)
        ]
    return listing


def _meshes(part: RenderRequest, store: Store, numbers: Sequence[int]) -> dict[str, Any]:
    """Return the mesh files of one subject: `done` ones are there, `remote` ones in the remote store."""
    rows = []
    for number in numbers:
        key = part.keys.mesh(number)
        state = (
            "done" if store.is_here("mesh", key) else "remote" if store.is_remote("mesh", key) else "missing"
        )
        rows.append({"frame": number, "key": key, "file": store.path("mesh", key).as_posix(), "state": state})
    return {"name": part.folders.title, "meshes": rows}


def _cameras(request: RenderRequest, store: Store) -> dict[int, dict[str, Any]] | None:
    """Return the camera of each frame, degrees and scene units; None while they are not framed.

    A wide camera, of a panorama or dome, has no field of view.
    """
    framed = request.pictures.framings(store)
    if framed is None:
        return None
    cameras = {}
    for number in request.requested:
        camera = framed[number].camera
        view = None if camera.projection.is_wide else math.degrees(camera.field_of_view)
        cameras[number] = {
            "position": camera.origin,
            "target": camera.target,
            "up": camera.up,
            "field_of_view": view,
            "focus_distance": camera.focus_distance,
        }
    return cameras


def _answer(facts: Mapping[str, Any]) -> None:
    typer.echo(json.dumps(facts, allow_nan=False))


@contextmanager
def _errors_answered() -> Iterator[None]:
    """Answer errors as JSON too, and let them end the command."""
    try:
        yield
    except FlowsculptError as error:
        _answer({"error": str(error), "changed": isinstance(error, StaleError)})
        raise

"""From a file to a shot: everything wrong with a file is told at once, with line and column."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from pipeline.flow import Sequence, Streamlines
from pipeline.flow.streamlines import DEFAULT_TOLERANCE
from pipeline.mesh.bspline import PIECES
from pipeline.shot.checks import adaptive
from pipeline.shot.checks import file_checks as checks
from pipeline.shot.checks import threshold_checks as brackets
from pipeline.shot.checks import timing as keys
from pipeline.shot.checks.timing import with_speed
from pipeline.shot.clock import Clock
from pipeline.shot.documents import bsdf as inline
from pipeline.shot.documents import camera as camera_document
from pipeline.shot.documents import lights_and_stage as sets
from pipeline.shot.documents import look_parts as materials
from pipeline.shot.documents import subject as point_documents
from pipeline.shot.documents.curves import number
from pipeline.shot.documents.fields import Document
from pipeline.shot.documents.resampling import ResampleDocument
from pipeline.shot.documents.shot import ModelDocument, ShotDocument
from pipeline.shot.documents.subject import SolidDocument
from pipeline.shot.motion import DEFAULT_MAX_STEP, Motion
from pipeline.shot.point_subjects import CloudOfFile, ControlNet, NetOfFile
from pipeline.shot.shot import Picture, Shot
from pipeline.shot.shutter import PictureLayers, Shutter
from pipeline.shot.subject import Model, Subject
from pipeline.shot.yaml.inheritance import layered
from pipeline.shot.yaml.lookup import digest_of_file
from pipeline.shot.yaml.messages import parsed
from pipeline.shot.yaml.parse_context import Surroundings
from pipeline.shot.yaml.source import Source
from render.scene.look import LOOKS
from render.scene.quality import QUALITIES


def read_shot(
    path: str | Path,
    text: str | None = None,
    settings: Iterable[str] = (),
    beside: Mapping[str, str] | None = None,
    allow_code: bool = False,
) -> Shot:
    """The shot of a YAML file (docs/shot-files.md), or of `text` as if it stood there.

    settings    what takes the place of values in the file: `flows.0.vortex.strength=2`
    beside      the text of the files that it rests on, by name (see `layers.rests_on`), as if no others were
                there; by default they are read
    allow_code  whether its motion may run the Python files that it names; reading runs none

    Raises ShotError with one message `file:line:column: …` for each thing that is wrong, and
    MissingInputError where the file, or a model that it names, is not there.
    """
    source = layered(Path(path), text, tuple(settings), beside)
    clock, problems = checks.read_clock(source)
    retimed, faults = (None, []) if clock is None else with_speed(clock, source.get("speed"))
    problems += faults
    problems += keys.keys(source, retimed)
    for check in (
        checks.directions,
        brackets.ratio,
        brackets.bounds,
        brackets.splits,
        checks.solid,
        checks.clear_look,
        materials.measurable,
        inline.written_out,
        camera_document.camera,
        point_documents.resampled,
        point_documents.points,
        checks.tolerance,
        sets.dimmed,
        adaptive.saves_passes,
    ):
        problems += check(source)
    missing = list(checks.files(source))
    surroundings = Surroundings(source.path.parent, allow_code)
    context = {"clock": clock, "surroundings": surroundings}
    document = parsed(source, ShotDocument, problems, missing, context=context)
    assert clock is not None, "without problems there is a clock"
    motion = _motion(document, clock, source)
    subject, read = motion.subject, dict(surroundings.digests)
    if isinstance(subject, Model | CloudOfFile | NetOfFile):
        read[subject.path] = subject.digest
    return Shot(
        name=Path(path).stem,
        title=document.title,
        intent=document.intent,
        motion=motion,
        picture=_picture(document, clock, subject),
        path=Path(path),
        files=tuple(sorted(read.items())),
    )


def _motion(document: ShotDocument, clock: Clock, source: Source) -> Motion:
    resample = document.resample
    follow = partial(Streamlines, substeps=document.substeps, tolerance=_tolerance(document))
    flows = tuple(entry.build(clock, follow) for entry in document.flows)
    return Motion(
        frames=clock.frames,
        rate=clock.rate,
        subject=_subject(document, source),
        flow=Sequence(flows),
        resampling=resample.build(clock) if isinstance(resample, ResampleDocument) else None,
        speed=number(document.speed, clock),
        max_step=DEFAULT_MAX_STEP if document.max_step is None else float(document.max_step),
    )


def _tolerance(document: ShotDocument) -> float | None:
    """None where sub-steps are not chosen by their error."""
    if document.integrator != "adaptive":
        return None
    return DEFAULT_TOLERANCE if document.tolerance is None else float(document.tolerance)


def _subject(document: ShotDocument, source: Source) -> Subject:
    subject = document.subject
    if isinstance(subject, ModelDocument):
        file = source.path.parent / subject.model
        return Model(digest=digest_of_file(file), scale=float(subject.scale), path=file)
    return subject.build() if isinstance(subject, SolidDocument) else subject.build(source.path.parent)


def _picture(document: ShotDocument, clock: Clock, subject: Subject) -> Picture:
    return Picture(
        look=LOOKS[document.look] if isinstance(document.look, str) else document.look.build(),
        camera=document.camera.build(clock),
        lights=sets.lights_of(document.lights),
        stage=sets.stage_of(document.stage),
        view=document.view.build(),
        tessellate=document.smooth.tessellate or (PIECES if isinstance(subject, ControlNet) else 1),
        dicing=document.smooth.dicing,
        qualities={
            name: dataclasses.replace(quality, **_given(getattr(document.quality, name)))
            for name, quality in QUALITIES.items()
        },
        shutter=document.shutter.build(clock) if document.shutter else Shutter(),
        layers=PictureLayers.of(document.aovs),
    )


def _given(document: Document, *registry: str) -> dict[str, Any]:
    """What a document sets, beyond the registry's name where it has one, lists as tuples."""
    values = document.model_dump(exclude_none=True, exclude=set(registry))
    return {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}

"""Reading a shot file: all mistakes are reported at once, with line and column."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ConfigDict, TypeAdapter, ValidationError

from flowsculpt.pipeline.errors import AbsentFilesError, MeshError, MissingInputError, ShotError, UsageError
from flowsculpt.pipeline.flow import Flow, Sequence, Streamlines
from flowsculpt.pipeline.flow.parameters import ORIGIN
from flowsculpt.pipeline.flow.streamlines import DEFAULT_TOLERANCE
from flowsculpt.pipeline.frames import FrameRate
from flowsculpt.pipeline.mesh.control_net import PIECES
from flowsculpt.pipeline.mesh.read import ModelFile
from flowsculpt.pipeline.shot import motion_checks, picture_checks, subject_checks
from flowsculpt.pipeline.shot.animated_models import AnimatedFlow, AnimatedModel
from flowsculpt.pipeline.shot.camera_path import Shutter
from flowsculpt.pipeline.shot.documents.curves import NumberField, number
from flowsculpt.pipeline.shot.documents.field_types import Document, vector
from flowsculpt.pipeline.shot.documents.light_documents import StageDocument
from flowsculpt.pipeline.shot.documents.look_documents import check_bsdf, look_of
from flowsculpt.pipeline.shot.documents.picture_documents import built_lights
from flowsculpt.pipeline.shot.documents.resampling import ResampleDocument
from flowsculpt.pipeline.shot.documents.shot_documents import ShotDocument, SoundDocument, entries_of_plugins
from flowsculpt.pipeline.shot.documents.subject_documents import (
    SubjectDocument,
    SubjectEntry,
    SubjectSettings,
)
from flowsculpt.pipeline.shot.documents.subject_kinds import MovingKind, NamedKind, PointsKind
from flowsculpt.pipeline.shot.motion import Clock, Loop, Motion, parse_frames, parse_rate
from flowsculpt.pipeline.shot.shot import AovSelection, Picture, Shot, SoundTrack
from flowsculpt.pipeline.shot.subjects import Model, PluginSurface, SeveralSubjects, Solid, Subject
from flowsculpt.pipeline.shot.yaml.document_validation import Checks, ParseContext, unforeseen, validated
from flowsculpt.pipeline.shot.yaml.inheritance import inherited_source
from flowsculpt.pipeline.shot.yaml.named_files import name_fault, quote_name
from flowsculpt.pipeline.shot.yaml.yaml_source import Problem, Where, YamlSource
from flowsculpt.render.base.render_errors import BadInputError
from flowsculpt.render.scene.materials import Material, Painted
from flowsculpt.render.scene.measured_colours import shows_values
from flowsculpt.render.scene.render_quality import qualities_for
from flowsculpt.render.scene.scene_lights import LightRig
from flowsculpt.render.scene.scene_stage import STAGES, Stage

CHECKS = (
    motion_checks.check_directions,
    motion_checks.check_edge_length_ratio,
    motion_checks.check_threshold_bounds,
    motion_checks.check_splits,
    subject_checks.check_solid,
    subject_checks.check_solid_size,
    subject_checks.check_stage,
    picture_checks.check_named_settings,
    picture_checks.check_set,
    picture_checks.check_clear_look,
    picture_checks.check_paint,
    picture_checks.check_measured_look,
    check_bsdf,
    picture_checks.check_camera,
    picture_checks.check_wide_camera,
    motion_checks.check_resample_entry,
    subject_checks.check_named_kind,
    motion_checks.check_tolerance,
    motion_checks.check_sounds,
    picture_checks.check_dimmed_lights,
    picture_checks.check_light_groups,
    picture_checks.check_noise_threshold,
    picture_checks.check_overrides,
)
FILE_CHECKS = (
    subject_checks.check_one_or_several,
    subject_checks.check_focus,
    subject_checks.check_copies,
    picture_checks.check_drawn_alone,
)
"""Checks beyond the form of single values. Each looks at the raw data, so that no mistake hides another.

Those of CHECKS look at a file as if each of several subjects were its only one.
"""

L = TypeVar("L", Material, Material | None)

_SPEED: TypeAdapter[Any] = TypeAdapter(NumberField, config=ConfigDict(strict=True, allow_inf_nan=False))


def read_shot(
    path: str | Path,
    text: str | None = None,
    settings: Iterable[str] = (),
    beside: Mapping[str, str] | None = None,
    allow_code: bool = False,
) -> Shot:
    """Read the shot of a YAML file (docs/shot-files.md), or of `text` in its place.

    settings    overrides of values in the file: `flows.0.vortex.strength=2`
    beside      texts of the files that it inherits from, by name (see `inheritance.inherited_files`); by
                default they are read
    allow_code  True if its motion may run the Python files that it names; reading runs none

    Raises ShotError with one message `file:line:column: …` for each mistake, and MissingInputError where the
    file, or a file that it names, is not there.
    """
    path = Path(path)
    if text is None and (fault := name_fault(path.stem)):  # a text may be of wedge.obj
        raise ShotError(f"{quote_name(path)}:1:1: {fault}")
    with unforeseen(path):
        return _read(inherited_source(path, text, tuple(settings), beside), allow_code)


@dataclass(frozen=True)
class WrittenShot:
    """What a shot file says, with all that it inherits and with settings of the command line on top.

    source  its values, with their places in files
    """

    source: YamlSource

    @classmethod
    def read(
        cls,
        path: Path,
        text: str | None = None,
        settings: Iterable[str] = (),
        beside: Mapping[str, str] | None = None,
    ) -> WrittenShot:
        """Read the file at `path`, or `text` in its place; arguments are those of `read_shot`.

        Raises ShotError and MissingInputError where text is not YAML or not there; it may be no valid shot.
        """
        return cls(inherited_source(path, text, tuple(settings), beside))

    @property
    def clock(self) -> Clock | None:
        """The clock of the shot with its speed; None where the file has mistakes in it."""
        clock, _ = read_clock(self.source)
        return None if clock is None else with_speed(clock, self.source)[0]

    def document(self, clock: Clock) -> ShotDocument:
        """Return the values of a valid shot, parsed. Raises pydantic's errors where there are mistakes."""
        context = {"clock": clock, "parse_context": ParseContext(self.source.path.parent)}
        return ShotDocument.model_validate(self.source.data, context=context)

    def outside_note(self, clock: Clock) -> str | None:
        """Return the note on keys outside of the shot, which still shape their curves; None without any."""
        return motion_checks.outside_note(self.source, clock)

    def place_of(self, subject: str, where: Where) -> str:
        """Return `file:line:column` of a setting of one of several subjects, as a shot of it alone has it.

        subject  empty for a shot of one
        """
        views = {view.name: view for view in subject_checks.subject_views(self.source)}
        return self.source.place(views[subject].in_file(where) if subject in views else where)


def _read(source: YamlSource, allow_code: bool) -> Shot:
    clock, problems = read_clock(source)
    retimed, faults = (None, []) if clock is None else with_speed(clock, source)
    checks = Checks(source, [*problems, *faults])
    for check in FILE_CHECKS:
        checks.run(check)
    views = subject_checks.subject_views(source)
    missing: list[Problem] = []
    for view in views:
        of_view = Checks(view.source)
        missing += view.problems(_checked(of_view, retimed), source)
        checks.problems += view.problems(of_view.problems, source)
        checks.failures += of_view.failures
    if not views:
        missing += _checked(checks, retimed)
    parse_context = ParseContext(source.path.parent, allow_code)
    context = {"clock": clock, "parse_context": parse_context}
    document = validated(checks, ShotDocument, missing, context=context)
    assert clock is not None and retimed is not None, "without problems there is a clock"
    parse_context.notes.extend(filter(None, [motion_checks.outside_note(source, retimed)]))
    shot = Shot(
        name=source.path.stem,
        title=document.title,
        intent=document.intent,
        motion=_motion(document, document.subject, clock, source),
        picture=_picture(document, clock),
        path=source.path,
        sounds=_sounds(document, parse_context),
        notes=tuple(dict.fromkeys(parse_context.notes)),
        entries=entries_of_plugins(document),
    )
    digests = dict(parse_context.digests)
    if document.subjects is not None:
        shot = _with_subjects(shot, document, clock, source)
        _require_room(shot, source)
        parts = tuple(_with_materials(part, source, digests) for part in shot.subjects)
        notes = tuple(dict.fromkeys(note for part in parts for note in part.notes))
        picture = replace(shot.picture, look=parts[0].picture.look)
        shot = replace(shot, subjects=parts, picture=picture, notes=notes)
    _require_fixed_faces(shot, source)
    shot = _with_materials(shot, source, digests)
    _check_entries(shot, source)
    return _with_files(shot, {**parse_context.digests, **digests})  # flows note files of their frames


def _with_materials(shot: Shot, source: YamlSource, digests: dict[Path, str]) -> Shot:
    """Return a shot of one subject whose look `model` has the materials of its model, and their notes.
    Note their files.

    Raises MissingInputError for a file of them that is not there, ShotError for one that cannot be read.
    """
    subject, picture = shot.motion.subject, shot.picture
    looks = [picture.look, *(each.look for each in picture.overrides)]
    if not (
        isinstance(subject, Model) and subject.paint and any(isinstance(look, Painted) for look in looks)
    ):
        return _with_values(shot, source)
    place = source.place(("subjects", shot.subject, "model") if shot.subject else ("subject", "model"))
    try:
        materials = ModelFile(subject.path, subject.part).materials()
    except MissingInputError as error:
        raise MissingInputError(f"{place}: {error}") from None
    except (MeshError, BadInputError) as error:
        raise ShotError(f"{place}: {error}") from None
    digests.update(materials.files)

    def painted(look: L) -> L:
        return replace(look, parts=materials.parts) if isinstance(look, Painted) else look

    overrides = tuple(replace(each, look=painted(each.look)) for each in picture.overrides)
    picture = replace(picture, look=painted(picture.look), overrides=overrides)
    notes = (f"model {subject.path.name}: {note}" for note in materials.notes)
    return replace(shot, picture=picture, notes=(*shot.notes, *notes))


def _with_values(shot: Shot, source: YamlSource) -> Shot:
    """Return a shot of one subject whose look, if it shows values, knows those of all frames."""
    look, pattern, animated = shot.picture.look, shot.picture.look.pattern, shot.motion.animated
    if shot.subjects or not shows_values(pattern):
        return shot
    if animated is None or "values" not in animated.model.sequence.facts(0.0):
        place = source.place(("subjects", shot.subject, "look") if shot.subject else ("look",))
        remedy = "Write values: speed in it" if animated else "Flows move it: write measure: {speed: {}}"
        raise ShotError(f"{place}: look shows values, and the subject has none. {remedy}.")
    measure = replace(pattern, quantiles=animated.model.sequence.quantiles)
    return replace(shot, picture=replace(shot.picture, look=look.with_values(measure=measure)))


def _checked(checks: Checks, clock: Clock | None) -> list[Problem]:
    """Run the checks of a file with one subject; return the problems with files that are not there."""
    checks.run(motion_checks.check_keys, clock)
    for check in CHECKS:
        checks.run(check)
    return list(subject_checks.check_files(checks.source))


def _with_subjects(shot: Shot, document: ShotDocument, clock: Clock, source: YamlSource) -> Shot:
    """Return the shot with the shots of its subjects. The first one's look decides the stage's colour."""
    shared = [f"flows.{index}" for index in range(len(document.flows))]
    motions: dict[str, Motion | None] = dict.fromkeys(document.subjects or {})
    subjects = []
    for name, entry in (document.subjects or {}).items():
        motion = _motion(document, entry, clock, source, ("subjects", name), motions)
        places = (*shared, *(f"subjects.{name}.flows.{i}" for i in range(len(entry.flows))))
        motions[name] = motion = replace(motion, flow_places=places)
        subjects.append(replace(shot, subject=name, motion=motion, picture=_picture(document, clock, entry)))
    first = subjects[0].picture
    picture = replace(shot.picture, look=first.look, stage=first.stage)
    return replace(shot, picture=picture, subjects=tuple(subjects))


def _require_room(shot: Shot, source: YamlSource) -> None:
    """Raise ShotError where copies of solids find no room; whoever reads a model finds out about it."""
    faults = []
    for part in shot.subjects:
        if part.motion.copies is not None and isinstance(part.motion.subject, Solid):
            try:
                part.motion.analytic_surface()
            except UsageError as error:
                faults.append(f"{source.place(('subjects', part.subject, 'copies'))}: {error}")
    if faults:
        raise ShotError(*faults)


def _with_files(shot: Shot, digests: Mapping[Path, str]) -> Shot:
    """Return the shot, and those of its subjects, with the files that it was read from."""
    files = dict(digests)
    for part in shot.parts:
        files |= dict(part.motion.subject.files)
    listed = tuple(sorted(files.items()))
    return replace(shot, files=listed, subjects=tuple(replace(part, files=listed) for part in shot.subjects))


def _sounds(document: ShotDocument, context: ParseContext) -> tuple[SoundTrack, ...]:
    """Return what is heard: the shot's sound, or each file that values follow, from its earliest start."""
    if isinstance(document.sound, SoundDocument):
        return (document.sound.build(context.folder),)
    if document.sound == "off":
        return ()
    earliest: dict[str, tuple[float, Path, float]] = {}
    for sound in context.sounds:
        digest = context.digests[sound[1]]
        earliest[digest] = min(earliest.get(digest, sound), sound)
    return tuple(
        SoundTrack(path.absolute(), digest, start, silence=silence)
        for digest, (start, path, silence) in earliest.items()
    )


def read_clock(source: YamlSource) -> tuple[Clock | None, list[Problem]]:
    """Return the shot's clock, without its speed, or the problems with it."""
    rate, problems = read_rate(source)
    text = source.get("frames")
    if not isinstance(text, str):
        return None, problems  # the document reports it
    try:
        frames = parse_frames(text, rate)
    except UsageError as error:
        return None, [*problems, (("frames",), str(error))]
    loop = Loop.of(source.get("loop"))
    if loop is not None and 2 * loop.count > len(frames):
        fact = f"a dissolve of {loop.count} frames needs {2 * loop.count}, and the shot has {len(frames)}"
        problems.append((("loop", "dissolve"), f"{fact}. Shorten it, or make the shot longer."))
    return (Clock(frames, rate, loop=loop) if rate else None), problems


def read_rate(source: YamlSource) -> tuple[FrameRate | None, list[Problem]]:
    """Return the frame rate, 24 by default, or the problem with it."""
    try:
        return parse_rate(source.get("rate")), []
    except UsageError as error:
        return None, [(("rate",), str(error))]


def with_speed(clock: Clock, source: YamlSource) -> tuple[Clock, list[Problem]]:
    """Return the clock with the speed of the file, and the problem with it between half frames.

    The keys of flows go by the speed, so it is read before the rest of the file. The document and its checks
    report a speed that is not valid; the clock is returned without it.
    """
    alone = replace(source, data={"speed": source.get("speed")})
    if any(motion_checks.check_keys(alone, clock)):
        return clock, []
    try:
        context = {"clock": clock, "parse_context": ParseContext(source.path.parent)}
        parsed = _SPEED.validate_python(source.get("speed"), context=context)
        retimed = replace(clock, speed=number(parsed, clock))
    except (ValidationError, AssertionError):
        return clock, []
    fault = retimed.speed_fault()
    return (clock, [(("speed",), fault)]) if fault else (retimed, [])


def _given(kind: MovingKind, source: YamlSource, clock: Clock, where: Where = ("subject",)) -> AnimatedModel:
    """Return the subject that a kind reads. Raises ShotError or MissingInputError with its place."""
    place = source.place((*where, kind.word()))
    try:
        model = kind.build(source.path.parent, clock)
    except MissingInputError as error:
        raise MissingInputError(f"{place}: {error}") from None
    except (MeshError, UsageError, BadInputError) as error:
        raise ShotError(f"{place}: {error}") from None
    if model.sequence.absent is not None:
        present, message = model.sequence.absent
        raise AbsentFilesError(f"{place}: {message}", present)
    return model


def _check_entries(shot: Shot, source: YamlSource) -> None:
    """Raise ShotError for what entries of plug-ins find in the shot."""
    for name, entry in shot.entries.items():
        try:
            if isinstance(entry, Document):
                entry.check_shot(shot)
        except UsageError as error:
            raise ShotError(f"{source.place(tuple(name.split('.')))}: {error}") from None


def _require_fixed_faces(shot: Shot, source: YamlSource) -> None:
    """Raise ShotError for what an animated model cannot have because its faces change, or in any case."""
    faults = []
    for part in shot.parts:
        if part.motion.animated is None:
            continue
        motion, model = part.motion, part.motion.animated.model
        name, entry = model.path.name, ("subjects", part.subject) if part.subject else ()
        asks = {"resample": motion.resampling, "flows": motion.flow.members, "copies": motion.copies}
        asked = [setting for setting, value in asks.items() if value]
        place = source.place((*entry, *asked[:1]) if asked else entry or ("subject",))
        if motion.is_rigid:
            faults.append(f"{place}: rigid copies keep one shape, and {name} moves. Leave rigid out.")
        elif not model.keeps_faces and (asked or model.paint):
            setting = [*asked, "paint"][0]
            faults.append(
                f"{place}: the faces of {name} change from frame to frame, so frames show their own, and "
                f"{setting} has no surface to follow. Leave {setting} out."
            )
        elif motion.resampling and (motion.resampling.method, motion.resampling.placement) != (
            "triangles",
            "exact",
        ):
            faults.append(
                f"{place}: new vertices get exact places on {name}. Leave method and placement out."
            )
    if faults:
        raise ShotError(*faults)


def _motion(
    document: ShotDocument,
    subject: SubjectDocument | SubjectEntry | None,
    clock: Clock,
    source: YamlSource,
    where: Where = ("subject",),
    motions: Mapping[str, Motion | None] | None = None,
) -> Motion:
    """Return the motion of a subject beside `motions`; without one, of what moves all subjects."""
    resample, flows, folder = document.resample, document.flows, source.path.parent
    place, copies = ORIGIN, None
    if isinstance(subject, SubjectSettings):
        flows = [*flows, *subject.flows]
        of_shot = "off" if isinstance(subject, NamedKind) else document.resample
        resample = of_shot if subject.resample is None else subject.resample
        place = vector(subject.place)
        copies = None if subject.copies is None else subject.copies.build(clock)
    integrate = partial(Streamlines, substeps=document.substeps, tolerance=_tolerance(document))
    built: Subject
    if subject is None:
        resample, built = "off", SeveralSubjects(tuple(document.subjects or ()))
    elif isinstance(subject, MovingKind):
        built = _given(subject, source, replace(clock, speed=number(document.speed, clock)), where)
    else:
        built = subject.build(folder)
    resampling = shape = None
    if isinstance(resample, ResampleDocument):
        resampling = resample.build(clock)
        if isinstance(built, PluginSurface) and len(built.mesh.creases) and resample.creases is None:
            resampling = replace(resampling, creases="model")
    if copies is not None and copies.rigid:
        resampling, shape = None, resampling
    acting: list[Flow] = []
    if isinstance(built, AnimatedModel) and built.keeps_faces:
        acting.append(AnimatedFlow(built))
    for index, entry in enumerate(flows, -len(document.flows)):
        flow, shared = entry.build(clock, integrate), ("flows", index + len(document.flows))
        try:
            if subject is not None:
                flow = flow.of_subject(built, place, acting).beside(str(where[-1]), motions or {})
        except UsageError as error:
            spot = source.place(shared if index < 0 else (*where, "flows", index))
            raise ShotError(f"{spot}: {error}") from None
        acting = [flow] if flow.acts_around_earlier else [*acting, flow]
    if isinstance(resample, ResampleDocument) and resample.rest_interval is None and resampling is not None:
        intervals = [flow.rest_interval for flow in acting if flow.rest_interval is not None]
        resampling = replace(resampling, rest_interval=min([resampling.rest_interval, *intervals]))
    if isinstance(built, AnimatedModel) and resampling is not None:
        # points find their faces in the first frame
        resampling = replace(resampling, normals="geometric", rest_interval=len(clock.frames) + 1)
    return Motion(
        frames=clock.frames,
        rate=clock.rate,
        subject=built,
        flow=Sequence(tuple(acting)),
        loop=clock.loop,
        resampling=resampling,
        speed=number(document.speed, clock),
        max_step=None if document.max_step is None else float(document.max_step),
        place=place,
        copies=copies,
        shape=shape,
    )


def _tolerance(document: ShotDocument) -> float | None:
    """Return the tolerance of the adaptive integrator; None for others."""
    if document.integrator != "adaptive":
        return None
    return DEFAULT_TOLERANCE if document.tolerance is None else float(document.tolerance)


def _stage(document: str | StageDocument, look: Material) -> Stage:
    """Return the stage of a shot. Where none is written, a cyclorama's colour suits the look."""
    stage = STAGES[document] if isinstance(document, str) else document.build()
    is_written = isinstance(document, StageDocument) and document.colour is not None
    if is_written or look.stage_colour is None or stage.kind not in ("cyclorama", "plinth"):
        return stage
    return replace(stage, colour=look.stage_colour)


def _grouped(lights: LightRig, groups: str | dict[str, list[str]]) -> LightRig:
    """Return the lights of a shot with its light groups."""
    return lights if groups == "off" else lights.grouped(groups if isinstance(groups, dict) else {})


def _picture(document: ShotDocument, clock: Clock, entry: SubjectEntry | None = None) -> Picture:
    """Return the picture of a shot, or of one of its subjects, whose own look no override replaces."""
    smooth, own = document.smooth, None if entry is None else entry.look
    look = look_of(document.look if own is None else own)
    grouped = partial(_grouped, groups=document.light_groups)
    overrides = [override.build(grouped) for override in document.overrides]
    subject = document.subject if entry is None else entry
    is_net = isinstance(subject, PointsKind) and subject.is_net
    is_plain = smooth.tessellate is None and smooth.dicing is None and not is_net
    camera, shape = document.camera.build(clock), document.picture
    sizes = qualities_for(camera.projection, None if shape is None else shape.final)
    return Picture(
        look=look,
        camera=replace(camera, aspect=sizes["final"].aspect),
        lights=grouped(built_lights(document.lights)),
        overrides=tuple(overrides if own is None else [replace(each, look=None) for each in overrides]),
        stage=_stage(document.stage, look),
        view=replace(document.view.build(), working_space=document.working_space),
        tessellate=smooth.tessellate or (PIECES if is_net else 1),
        dicing=smooth.dicing,
        hide_facets=is_plain and look.is_lit,
        qualities={
            name: replace(quality, **getattr(document.quality, name).settings())
            for name, quality in sizes.items()
        },
        shutter=document.shutter.build(clock) if document.shutter else Shutter(),
        aovs=AovSelection.of(document.aovs),
        layers=document.layers,
    )

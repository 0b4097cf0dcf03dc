"""From raw pictures to finished ones: noise removed within each and over time, layers for compositing."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flowsculpt.pipeline.errors import FrameError, MachineError
from flowsculpt.pipeline.frames import FrameRate
from flowsculpt.pipeline.plugin import named, plugins
from flowsculpt.pipeline.production.request.keys import FrameKeys, PictureKeys
from flowsculpt.pipeline.production.request.render_request import RenderRequest
from flowsculpt.pipeline.production.stages import FINISH, STAGES
from flowsculpt.pipeline.production.store.store import key_of, shared_file
from flowsculpt.pipeline.production.tasks.job import Context
from flowsculpt.render.base.atomic_write import atomic_write
from flowsculpt.render.base.foreign_code import is_of_user, located_reason
from flowsculpt.render.base.root_files import remove_file
from flowsculpt.render.base.state_files import UNUSABLE
from flowsculpt.render.movie.codecs import timecode
from flowsculpt.render.post.compositing import LayerInputs, Viewpoint, compositing_layers, mattes_header
from flowsculpt.render.post.denoise import FilmDenoiser, RawFrame
from flowsculpt.render.post.exr_names import ExrAttributes
from flowsculpt.render.post.image import write_exr
from flowsculpt.render.scene.aovs import DENOISER, Pixels, RenderedFrame
from flowsculpt.render.scene.materials import LOOKS, Material
from flowsculpt.render.scene.scene import SUBJECT
from flowsculpt.render.scene.scene_lights import groups_in, light_layers, with_beauty

if TYPE_CHECKING:
    from flowsculpt.pipeline.production.request.framing import Framing


def finish(context: Context) -> bool:
    """Finish the pictures of a batch: noise removed, with alpha and the layers that the shot asks for.

    Pictures that could not be rendered are left out; their failure is reported already.
    """
    request = context.request
    keys = context.picture_keys(request)
    framings: Mapping[int, Framing] = request.pictures.framings(context.store) or {}
    denoiser, output = _Denoiser(context, keys, framings), FinishedFrames(request, framings)

    def work(number: int) -> bool:
        def write(path: Path) -> None:
            layers, header = denoiser.finished(number)
            for name in request.keys.last_stages:
                layers = _apply_stage(name, layers, number, request, framings[number])
            output.write(path, number, layers, {**header, "key": keys[number].frame})

        return context.make("frame", keys[number].frame, request.place("frame", number), write)

    lost = {number for stage in FINISH.reads for number in context.failures.frames(stage)}
    ready = [n for n in context.job.frames if not lost & {*keys[n].window}]
    well = context.for_each(ready, work)
    denoiser.shared.clear()
    for number in {*context.job.frames} - {*ready} - lost:
        others = ", ".join(str(n) for n in sorted(lost & {*keys[number].window}))
        context.fail(FrameError(f"frame {number} averages frame {others}, which failed"), number)
    return well and len(ready) == len(context.job.frames)


@dataclass(frozen=True)
class _BorderLight:
    """The light of pictures that several batches need, since they average over the borders between them.

    The batch that needs a picture first denoises it, and leaves its light in a file for the others. Each
    begins with its own, so that batches that work at the same time find what they need of each other.
    """

    context: Context
    keys: PictureKeys

    @cached_property
    def _users(self) -> Mapping[int, Sequence[int]]:
        """The pictures of other batches that average over one that this batch needs, too, by its number; none
        in a forced run."""
        job, plan, reach = self.context.job, self.context.plan, self.context.request.pictures.reach
        if self.context.is_forced or not reach:
            return {}
        batches = [each for each in plan.jobs if (each.stage, each.requests) == (job.stage, job.requests)]
        first, last = min(job.frames) - 2 * reach, max(job.frames) + 2 * reach
        others = {n for each in batches for n in each.frames if first <= n <= last} - {*job.frames}
        read = {number for own in job.frames for number in self.keys[own].window}
        users = {number: [n for n in others if number in self.keys[n].window] for number in read}
        return {number: near for number, near in users.items() if near}

    @property
    def own(self) -> list[int]:
        """The pictures that this batch finishes and other batches still need."""
        return [number for number in self.context.job.frames if self._is_needed(number)]

    def _is_needed(self, number: int) -> bool:
        """Tell whether another batch still needs a picture."""
        store = self.context.store
        return any(not store.holds("frame", self.keys[n].frame) for n in self._users.get(number, ()))

    def _file(self, number: int) -> Path:
        names, quality = self.keys[number], self.context.request.pictures.quality
        key = key_of(FINISH.recipe, names.raw, list(names.staged.values()), quality.denoise)
        return shared_file(self.context.store, Path(self.context.request.place("raw", number)), key)

    def get(self, number: int) -> Pixels | None:
        if number not in self._users:
            return None
        try:
            with np.load(self._file(number), allow_pickle=False) as arrays:
                light: Pixels = arrays["light"]
                return light
        except (*UNUSABLE, zipfile.BadZipFile, zlib.error, EOFError):
            return None

    def put(self, number: int, light: Pixels) -> None:
        if not self._is_needed(number):
            return
        file = self._file(number)
        with (
            suppress(MachineError),  # the next batch denoises it again
            atomic_write(file, self.context.store.draft(file.suffix), flush=False) as draft,
            draft.open("wb") as written,
        ):
            np.savez(written, allow_pickle=False, light=light)

    def clear(self) -> None:
        """Remove the light that no other batch needs any more."""
        for number in self._users:
            if not self._is_needed(number):
                with suppress(OSError, MachineError):
                    remove_file(self._file(number))


def plugin_stage(context: Context) -> bool:
    """Do a plug-in's stage on the pictures of a batch. Pictures that failed before are left out."""
    stage, request, keys = STAGES[context.job.stage], context.request, context.picture_keys(context.request)
    entry, precision = request.manifest.stages[stage.name], dict(request.pictures.aovs.precision)
    framings: Mapping[int, Framing] = request.pictures.framings(context.store) or {}

    def work(number: int) -> bool:
        def write(path: Path) -> None:
            frame, header = read_source(context, keys[number], number, before=stage.name)
            made = _apply_stage(stage.name, frame, number, request, framings[number])
            header |= {"key": keys[number].staged[stage.name]}
            header |= {"stages": {**header.get("stages", {}), stage.name: stage.recipe}}
            header |= {"entries": {**header.get("entries", {}), stage.name: entry}}
            attributes = raw_attributes(request, framings[number])
            write_exr(path, made, header, precision, attributes=attributes, compression="rle")

        return context.make("raw", keys[number].staged[stage.name], request.place(stage.name, number), write)

    lost = {number for before in stage.reads for number in context.failures.frames(before)}
    ready = [number for number in context.job.frames if number not in lost]
    return context.for_each(ready, work) and len(ready) == len(context.job.frames)


def _apply_stage(
    name: str, frame: RenderedFrame, number: int, request: RenderRequest, framing: Framing
) -> RenderedFrame:
    """Return a frame after the picture stage of an entry. Raises what `_made_by` raises."""
    plugin, stage = plugins().picture_stages[name]
    quality, place = request.pictures.quality, f"plug-in {plugin.name}: {stage.task}"
    corner = quality.crop[:2] if quality.crop else (0, 0)
    told = {**frame.facts, "whole": (quality.width, quality.height), "corner": corner}
    frame = replace(frame, facts={**told, "shot": request.shot, "camera": framing.camera})
    return replace(_made_by(named(stage.task), place, frame, request.shot.entries[name], number), facts=told)


def _made_by(
    task: Callable[..., RenderedFrame], place: str, frame: RenderedFrame, settings: Any, number: int
) -> RenderedFrame:
    """Return what the task of a plug-in makes of a frame. Raises FrameError where that is not a frame."""
    shapes = {name: layer.shape for name, layer in frame.arrays.items()}
    try:
        made = task(frame, settings, number)
    except FrameError:
        raise
    except BaseException as error:  # a stranger's function may raise anything
        if is_of_user(error):
            raise
        raise FrameError(f"{place} raised {located_reason(error)}", number) from error
    if not isinstance(made, RenderedFrame):
        raise FrameError(f"{place} returned {type(made).__name__}; a stage returns a RenderedFrame", number)
    for name, shape in shapes.items():
        if name not in made.arrays:
            raise FrameError(f"{place}: layer {name} is missing; return all that the frame has", number)
        if made[name].shape != shape:
            raise FrameError(f"{place}: layer {name} has the shape {made[name].shape}, not {shape}", number)
    if not np.isfinite(made["beauty"]).all():
        raise FrameError(f"{place}: the beauty is not finite", number)
    return _with_groups(made, frame)


def _with_groups(made: RenderedFrame, frame: RenderedFrame) -> RenderedFrame:
    """Return what a stage has made of a frame, whose light groups sum to its beauty.

    A stage that changes the beauty alone changes all groups by the same factors. Light that it adds where
    there was none is in the first group.
    """
    names = light_layers(frame.arrays)
    are_left_alone = all(np.array_equal(made[name], frame[name]) for name in names)
    before, after = frame["beauty"].astype(np.float64), made["beauty"]
    if not names or not are_left_alone or np.array_equal(before, after):
        return made
    factor = np.divide(after, before, out=np.zeros_like(before), where=before != 0.0)
    groups = {name: made[name] * factor for name in names}
    groups[names[0]] += np.where(before == 0.0, after, 0.0)
    singles = {name: group.astype(np.float32) for name, group in groups.items()}
    return replace(made, arrays={**made.arrays, **singles})


def read_source(
    context: Context, keys: FrameKeys, number: int, before: str = ""
) -> tuple[RenderedFrame, dict[str, Any]]:
    """Read the picture that is denoised or, before a plug-in's stage, what that one reads."""
    names = list(keys.staged)
    names = names[: names.index(before)] if before else names
    if not names:
        return context.read_picture(context.request, "raw", number, keys.raw)
    return context.read_picture(context.request, "raw", number, keys.staged[names[-1]], names[-1])


@dataclass(eq=False)
class _Denoiser:
    """Denoises the raw pictures of a batch, each read once.

    kept  of pictures read as neighbours, by number: the layers that finished ones need, and the header
    """

    context: Context
    keys: PictureKeys
    framings: Mapping[int, Framing]
    kept: dict[int, tuple[RenderedFrame, dict[str, Any]]] = field(default_factory=dict)

    @cached_property
    def shared(self) -> _BorderLight:
        return _BorderLight(self.context, self.keys)

    def finished(self, number: int) -> tuple[RenderedFrame, dict[str, Any]]:
        """Return a picture with its beauty free of noise, and its header: the raw one's, and the stage's."""
        window = self.keys[number].window
        light = self._denoiser.light(number, window)
        layers, raw = self.kept.get(number) or self._read(number)
        self.kept = {n: kept for n, kept in self.kept.items() if n in window and n > number}
        stages = {**raw.get("stages", {}), FINISH.name: FINISH.recipe}
        header = {**raw, "raw_key": self.keys[number].raw, "stages": stages}
        if len(window) > 1:
            header = {**header, "temporal_neighbours": [n for n in window if n != number]}
        light = np.where(layers["alpha"][..., None] > 0.0, light, np.float32(0.0))
        denoised = _layers_of(light, groups_in(layers.arrays))
        return RenderedFrame({**layers.arrays, **denoised}, layers.facts), header

    def _read(self, number: int) -> tuple[RenderedFrame, dict[str, Any]]:
        layers, header = read_source(self.context, self.keys[number], number)
        if "shadow" not in layers.arrays:
            return layers, header
        # Features of the shadow catcher, which is not seen, would blur the subject's outline.
        names = {"albedo", "normal", *DENOISER} & layers.arrays.keys()
        seen = {name: layers[name] * layers["alpha"][..., None] for name in names}
        return RenderedFrame({**layers.arrays, **seen}, layers.facts), header

    @cached_property
    def _denoiser(self) -> FilmDenoiser:
        quality = self.context.request.pictures.quality
        corner = quality.crop[:2] if quality.crop else (0, 0)
        size = quality.width, quality.height
        denoiser = FilmDenoiser(self._raw, quality.denoise, size, corner, self.shared)
        for number in self.shared.own:
            with suppress(FrameError):  # of a damaged raw picture, which fails the frames that average it
                denoiser.share(number)
        self.kept.clear()
        return denoiser

    def _raw(self, number: int) -> RawFrame:
        framing, (layers, header) = self.framings[number], self._read(number)
        self.kept[number] = self._kept_of(layers), header
        return RawFrame(layers, framing.camera, framing.placement)

    def _kept_of(self, layers: RenderedFrame) -> RenderedFrame:
        """Return the layers of a raw picture that its finished frame needs."""
        if self.context.request.manifest.layers is not None:
            return layers
        names = {"alpha", "shadow", *light_layers(layers.arrays)} & layers.arrays.keys()
        return RenderedFrame({name: layers[name] for name in names}, layers.facts)


def _layers_of(light: Pixels, groups: Iterable[str]) -> dict[str, Pixels]:
    """Return the layers in the channels of `FilmDenoiser.light`."""
    parts = (light[..., first : first + 3] for first in range(3, light.shape[2], 3))
    layers = dict(zip(groups, parts, strict=True))
    return with_beauty(layers) if layers else {"beauty": light}


@dataclass(frozen=True)
class FinishedFrames:
    """Writes the finished frames of a request.

    framings  camera and stage of every picture
    """

    request: RenderRequest
    framings: Mapping[int, Framing]

    def write(self, path: Path, number: int, frame: RenderedFrame, header: Mapping[str, Any]) -> None:
        """Write a finished frame; `frame` has the raw AOVs, and the finished light as its beauty."""
        request, standard = self.request, {}
        shadow = {"shadow": frame["shadow"]} if "shadow" in frame.arrays else {}
        alpha = np.minimum(sum(shadow.values(), frame["alpha"]), np.float32(1.0))
        groups = {name: frame[name] for name in light_layers(frame.arrays)}
        layers = light = {"beauty": frame["beauty"], "alpha": alpha, **groups}
        if request.manifest.layers is not None:
            inputs = self._inputs(number)
            extra = {name: frame[name] for name, _ in request.manifest.precision if name in frame.arrays}
            layers = {**extra, **compositing_layers(frame, inputs), **shadow, **light}
            standard = mattes_header(frame, inputs, request.manifest.layers)
        shown = RenderedFrame(layers, frame.facts)
        write_finished(path, request, number, self.framings, shown, header, standard)

    def _inputs(self, number: int) -> LayerInputs:
        """Return what `compositing_layers` needs besides the AOVs."""
        from flowsculpt.pipeline.production.request.shading import framing_at  # takes a moment

        picture, quality = self.request.pictures.of(number), self.request.pictures.quality
        around = (framing_at(self.framings, number, offset) for offset in (0.0, -1.0, 1.0))
        now, before, after = (Viewpoint(framing.camera, framing.placement) for framing in around)
        size = quality.width, quality.height
        parts = self.request.parts
        materials = {
            part.source.subject or SUBJECT: material_name(part.pictures.of(number).look) for part in parts
        }
        copies = self.request.pictures.copies
        return LayerInputs(now, before, after, size, picture.stage, materials, copies)


def material_name(look: Material) -> str:
    """Return the name of a look, or of its model where it is no look by name."""
    return next((name for name, known in LOOKS.items() if known == look), look.model)


def write_finished(
    path: Path,
    request: RenderRequest,
    number: int,
    framings: Mapping[int, Framing],
    layers: RenderedFrame,
    header: Mapping[str, Any],
    standard: Mapping[str, str] | None = None,
) -> None:
    """Write the layers of a finished frame as EXR, with rate, timecode and camera as all programs read them.

    framings  camera and stage of every picture
    header    plain data, which become `flowsculpt:` entries
    standard  more entries of the header by their whole names

    Precision and channel names are those that the shot asks for. Raises MachineError where the disk refuses.
    """
    rate = FrameRate.of(request.manifest.rate).fps
    raw = raw_attributes(request, framings[number])
    write_exr(
        path,
        layers,
        header,
        dict(request.manifest.precision),
        attributes=replace(raw, rate=rate, timecode=timecode(number, rate)),
        standard=standard,
        convention=request.manifest.layers,
    )


def raw_attributes(request: RenderRequest, framing: Framing) -> ExrAttributes:
    """Return the standard attributes of a raw picture, whose key knows no frame rate."""
    quality = request.pictures.quality
    return ExrAttributes(
        whole=(quality.width, quality.height),
        corner=quality.crop[:2] if quality.crop else (0, 0),
        camera=framing.camera,
    )

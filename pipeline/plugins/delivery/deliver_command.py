"""The command `deliver`: encode shots and films for others."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from flowsculpt import FrameError, UsageError
from flowsculpt.api import RunObserver, plugins, plural
from flowsculpt.api.commands import (
    Project,
    duration_words,
    execute,
    print_error,
    print_result,
    print_warning,
    progress_bars,
    report_plan,
    require_one_of,
)
from flowsculpt.api.frames import Plan, QualityName, RenderRequest, Show
from flowsculpt.api.options import (
    DEFAULT_QUALITY,
    Common,
    Frames,
    PictureOptions,
    Quality,
    shared_option,
)
from flowsculpt.api.pictures import HDR_DISPLAYS, AudioClip, BurnIn, Encode
from flowsculpt.pipeline.plugins.delivery.deliverables import (
    SLATES,
    DeliveredFile,
    Delivery,
    DeliveryOptions,
    film_source,
    lost_frames,
    shot_source,
)
from flowsculpt.pipeline.plugins.delivery.encodes import DELIVERABLES, encode_named
from flowsculpt.pipeline.plugins.delivery.gain_map import GAIN_MAP, is_gain_map, require_gain_maps
from flowsculpt.pipeline.plugins.delivery.png_still import PNG, require_one_frame
from flowsculpt.pipeline.plugins.delivery.relighting import RelitFrames, relit_version

USUAL_SIDES = dict.fromkeys(("phone", "hdr10", "hdr10-av1", "hlg"), 1080)
"""Pixels along the shorter side that the screens of deliverables usually show, by their names."""


def deliver(
    common: Common,
    names: Annotated[
        list[str], typer.Argument(metavar="NAME…", help="Shots or edits: names in shots/, or paths.")
    ],
    options: PictureOptions,
    forms: Annotated[
        str, typer.Option("--as", metavar="NAME,…", help=f"One or more of {', '.join(DELIVERABLES)}.")
    ] = "review",
    quality: Quality = DEFAULT_QUALITY,
    frames: Frames = None,
    slate: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(SLATES), help="Add a slate: before the first frame, or as its own file."
        ),
    ] = None,
    burn_in: Annotated[
        str | None,
        typer.Option("--burn-in", metavar="FIELD,…", help=f"Burn in: all, or {', '.join(BurnIn().fields)}."),
    ] = None,
    sound: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Add this sound. An edit may name its own.")
    ] = None,
    relit: Annotated[
        str | None,
        typer.Option(
            metavar="VERSION", help="Encode frames that `relight` made, by the name of their folder."
        ),
    ] = None,
    output: Annotated[
        Path | None, shared_option("output", "Default: the folder deliver beside the frames.", metavar="DIR")
    ] = None,
) -> None:
    """Encode shots and films for review, editing, archive or web, rendering what is missing.

    `flowsculpt deliver A010_cube --as review,prores4444 -q final --burn-in all` writes two files to
    renders/A010_cube/final/deliver; `flowsculpt deliver film --as h265 --slate head` the film with a slate.
    Files that are up to date are kept. Failed frames are shown as cards that state the reason.
    `flowsculpt deliver A010_cube -q final --relit key1.4` encodes frames of `relight`, and relights missing
    ones.

    Movies of spherical and VR180 shots have tags with which YouTube, VLC and headset players show them around
    the viewer, and names that end with _360 or _180_LR, which many players rely on.

    review: H.264 of intra frames, to step through · phone: H.264 of 8 bits, for phones and social networks ·
    h264, h265: 10 bits · hdr10, hdr10-av1: high dynamic range, for screens and the web · hlg: the same for
    broadcasters · avif: the same for pages · prores4444: with the subject's alpha · av1: for the web ·
    ffv1: lossless, for the archive · webp: for pages · gif: where nothing else plays · png: one frame with
    its cards, for posters · gain-map: one frame as JPEG whose highlights HDR screens show.
    """
    if slate is not None:
        require_one_of(slate, SLATES, f"--slate {slate}: a slate goes at the head or apart.")
    words = tuple(dict.fromkeys(word.strip() for word in forms.split(",") if word.strip()))
    if not words:
        raise UsageError(f"--as {forms!r} is not a deliverable. There are: {', '.join(DELIVERABLES)}.")
    for word in words:
        if word not in DELIVERABLES and (needed := plugins().lacking(word)):
            raise UsageError(f"{word!r} is not a deliverable. {needed}")
    order = DeliveryOptions(
        encodes=tuple(encode_named(word) for word in words),
        slate=slate,
        burn_in=None if burn_in is None else BurnIn.parse(burn_in),
        audio=None if sound is None else AudioClip.of_file(sound),
        folder=output,
    )
    project = options.project(common)
    wanted = _Wanted(project, tuple(names), options.quality(quality, project, names), frames, relit)
    wanted.relit_frames()  # refuses names that are none before anything is rendered
    if any(encode.display in HDR_DISPLAYS for encode in order.encodes):
        wanted.require_hdr()
    wanted.require_stills(order.encodes, slate)
    for warning in wanted.small_pictures(order.encodes):
        print_warning(warning)
    if common.dry_run:
        report_plan(common, wanted.plan())
        if not common.json:
            encodes = ", ".join(encode.name for encode in order.encodes)
            print_result(f"Then: encoding {', '.join(names)} as {encodes}.", None, as_json=False)
        return
    started = time.monotonic()
    outcome = execute(common, wanted.plan)
    failed = {
        (str(f["shot"]), int(f["frame"])): str(f["message"])
        for f in outcome.failures
        if f.get("frame") is not None
    }
    with progress_bars(common.progress) as bar:
        faults = [fault for each in wanted.relit_frames() for fault in each.mix(common.cores, bar)[1]]
    for fault in faults:
        print_error(fault)
    deliveries = wanted.deliveries(order, failed)
    with progress_bars(common.progress) as bar:
        done = [file for delivery in deliveries for file in delivery.make(bar)]
    lost = lost_frames(deliveries)
    if lost:
        print_warning(f"{'; '.join(lost)}: shown as cards that state the reason")
    facts = _facts(done, lost, time.monotonic() - started)
    for observer in RunObserver.of_plugins():
        observer.delivered(common, facts)
    _report(common, done, facts)
    raise typer.Exit(outcome.exit_code or (FrameError.exit_code if faults else 0))


@dataclass(frozen=True)
class _Wanted:
    """Names of shots and edits, the frames to encode, and the name of a relit version of them."""

    project: Project
    names: tuple[str, ...]
    quality: str
    frames: Frames
    relit: str | None

    def plan(self) -> Plan:
        """Return the plan that renders what is missing."""
        return self.project.frames(self._all_requests())

    def relit_frames(self) -> list[RelitFrames]:
        """Return the relit versions, none unless they are asked for. Raises what `relit_version` does."""
        if self.relit is None:
            return []
        return [relit_version(request, self.project.store, self.relit) for request in self._all_requests()]

    def require_hdr(self) -> None:
        """Raises BadInputError where light cannot be shown in high dynamic range."""
        for request in self._all_requests():
            request.shot.picture.view.in_hdr()

    def require_stills(self, encodes: Sequence[Encode], slate: str | None) -> None:
        """Raises UsageError for stills with a slate, and as `require_gain_maps`."""
        for encode in (encode for encode in encodes if encode.suffix in (GAIN_MAP.suffix, PNG.suffix)):
            for name in self.names:
                frames = sum(len(request.requested) for request in self._requests(name))
                require_one_frame(encode.name, frames)
                if is_gain_map(encode):
                    require_gain_maps(frames)
            if slate is not None:
                raise UsageError(f"{encode.name} holds one frame, and a slate is more; leave out --slate")

    def small_pictures(self, encodes: Sequence[Encode]) -> Iterator[str]:
        """Yield a line for each shot or edit with pictures smaller than screens of its deliverables show."""
        for name in self.names:
            request = self._requests(name)[0]
            width, height = request.pictures.quality.rendered_size
            small = [e.name for e in encodes if min(width, height) < USUAL_SIDES.get(e.name, 0)]
            if not small or QualityName.of(self.quality).crop:
                continue
            whole = replace(request, quality_name="final").pictures.quality
            remedy = "Write a larger picture: {size: …} in the shot."
            if whole.width > width:
                also = ", without --scale," if self.quality.partition(".")[0] == "final" else ""
                remedy = f"Use -q final{also} for {whole.width} × {whole.height}."
            yield (
                f"{', '.join(small)}: {name} has {width} × {height} pixels, and such screens usually show "
                f"{USUAL_SIDES[small[0]]} or more along the shorter side. {remedy}"
            )

    def _all_requests(self) -> list[RenderRequest]:
        return [request for name in self.names for request in self._requests(name)]

    def deliveries(self, order: DeliveryOptions, failed: Mapping[tuple[str, int], str]) -> list[Delivery]:
        store, made = self.project.store, []
        for name in self.names:
            if Show().names_edit(name):
                edit = self.project.edit(self.quality, Show().find_edit(name))[0]
                source = film_source(edit, self._requests(name), store, failed, self.relit)
            else:
                source = shot_source(self._requests(name)[0], store, failed, self.relit)
            made.append(Delivery(source, order, store))
        return made

    def _requests(self, name: str) -> list[RenderRequest]:
        """Return the request of a shot or those of an edit's clips, with the layers of finished frames."""
        if not Show().names_edit(name):
            return [self.project.as_finished(self.project.find_request(name, self.quality, self.frames))]
        if self.frames is not None:
            raise UsageError(f"-f {self.frames} chooses frames of shots; {name} is an edit and names its own")
        _, requests = self.project.edit(self.quality, Show().find_edit(name))
        return [self.project.as_finished(each) for each in requests]


def _facts(done: Sequence[DeliveredFile], lost: Sequence[str], seconds: float) -> dict[str, Any]:
    return {
        "deliverables": [
            {"path": str(f.path), "as": f.encode, "frames": f.frames, "up_to_date": f.reused} for f in done
        ],
        "failed": list(lost),
        "seconds": round(seconds, 2),
    }


def _report(common: Common, done: Sequence[DeliveredFile], facts: dict[str, Any]) -> None:
    lines = [f"{f.path}: {plural(f.frames, 'frame')}{', up to date' if f.reused else ''}" for f in done]
    print_result("\n".join([*lines, f"Done in {duration_words(facts['seconds'])}."]), facts, common.json)

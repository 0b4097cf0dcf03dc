"""The project: a root, its settings, and the plans of what can be asked for in it."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

from flowsculpt.pipeline.errors import AbsentFilesError, UsageError, suggest
from flowsculpt.pipeline.frames import FrameRange, FrameSelection, FrameWords
from flowsculpt.pipeline.production.planning.estimate import MeanTimings
from flowsculpt.pipeline.production.planning.frame_states import FrameStates, KnownPictures, select_frames
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.planning.planner import Planner
from flowsculpt.pipeline.production.planning.profile import Profile, variant_for
from flowsculpt.pipeline.production.planning.timings import measure_renders
from flowsculpt.pipeline.production.request.edit import Edit, ResolvedEdit, resolve_edit
from flowsculpt.pipeline.production.request.lookup import QualityName, Show, require_quality
from flowsculpt.pipeline.production.request.render_request import FORMS, RenderRequest
from flowsculpt.pipeline.production.request.shot_source import PlanningCache, ShotSource, SourceCache
from flowsculpt.pipeline.production.stages import forced_with
from flowsculpt.pipeline.production.store import paths
from flowsculpt.pipeline.production.store.history import History
from flowsculpt.pipeline.production.store.paths import STATE, Folders
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.scene.render_quality import CONVENTIONS, DEFAULT_QUALITY

MAIN_EDIT = Show().film

States = Callable[[RenderRequest, Store, History], FrameStates]


@dataclass(frozen=True)
class Project:
    """A root to write to, so many cores to use; shots are looked up in `shots/` of the working folder.

    Every file is read once, so that all of a run goes by one text however it is edited meanwhile.

    variant     the Mitsuba variant asked for; by default that of the profile, or the first that works here
    settings    what takes the place of values in every shot file asked for: `flows.0.vortex.strength=2`
    allow_code  whether shots may run the Python files that they name
    profile     where the jobs of its plans run, and so how many there are of them
    for_farm    whether other machines render, as they do where the profile names a farm
    force       stages that are made again, each with the time from which on stored files count
    notes       lines to tell the user with a plan
    """

    root: Path
    cores: int
    variant: str | None = None
    settings: tuple[str, ...] = ()
    allow_code: bool = False
    profile: Profile = field(default_factory=Profile.local)
    for_farm: bool = False
    force: Mapping[str, int] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list, repr=False)
    _texts: SourceCache = field(default_factory=SourceCache, repr=False)
    _edits: dict[Path, ResolvedEdit] = field(default_factory=dict, repr=False)
    _selected: dict[tuple[Path, str, FrameWords], FrameRange] = field(default_factory=dict, repr=False)

    @property
    def store(self) -> Store:
        return Store(self.root)

    @property
    def cache(self) -> PlanningCache:
        """What is kept of what was found out about shots, for as long as it holds."""
        return PlanningCache(self.root)

    @cached_property
    def history(self) -> History:
        """The history of frames under its root, as it is when it is first asked for."""
        return History.of(self.root)

    def force_from(self, stage: str) -> Project:
        """Return the project with a stage, and those that follow it, made again once whatever is stored."""
        return replace(self, force=dict.fromkeys(forced_with({stage}), time.time_ns()))

    def with_layers(self, convention: str | None) -> Project:
        """Return the project with layers for compositing in finished frames, in place of what shots say.

        Raises UsageError where no such channel names are known.
        """
        if convention is None:
            return self
        if convention not in CONVENTIONS:
            hint = suggest(convention, CONVENTIONS)
            raise UsageError(f"--layers {convention}: no channel names are known for it. {hint}")
        return replace(self, settings=(*self.settings, f"layers={convention}"))

    def planner(self, many: int = 1) -> Planner:
        """Return a planner for so many requests that are made side by side."""
        cores = self.profile.side_by_side(self.cores)
        side_by_side, share = max(1, cores // many), self.profile.share
        return Planner(
            self.store, side_by_side, cores, self.notes, share, force=self.force, comparable=many > 1
        )

    # Plans

    def meshes(self, shots: Sequence[str], frames: FrameSelection | None = None) -> Plan:
        """Return the plan of the mesh frames of shots."""
        planner = self.planner()
        for shot in shots:
            planner.simulate(
                self.find_request(shot, DEFAULT_QUALITY, frames, FrameStates.of_meshes, variant="none")
            )
        return planner.plan()

    def pictures(self, shots: Sequence[str], quality: str, frames: FrameSelection | None = None) -> Plan:
        """Return the plan of finished frames of shots and the movie of them."""
        planner = self.planner()
        for shot in shots:
            self.add_pictures(planner, shot, quality, frames)
        return planner.plan()

    def add_pictures(
        self, planner: Planner, shot: str, quality: str, frames: FrameSelection | None = None
    ) -> None:
        """Ask for finished frames of a shot and their movie; of the whole shot too where they complete it."""
        request = self.find_request(shot, quality, frames)
        planner.pictures(request)
        if not isinstance(frames, FrameWords):
            planner.movie(request)
        if frames is None or self.force:
            return
        whole, store = request.whole(), self.store
        keys = whole.keys.pictures(store)
        if keys is None:
            return
        rest = set(whole.requested) - set(request.requested)
        if all(store.holds("frame", keys[n].frame) or store.holds("raw", keys[n].raw) for n in rest):
            planner.pictures(whole)
            planner.movie(whole)
        keys.remember()

    def whole(
        self,
        shots: Sequence[str],
        quality: str,
        frames: FrameSelection | None = None,
        nodes: int | None = None,
    ) -> Plan:
        """Return the plan for a farm of finished frames of shots and their movies, whatever is stored.

        nodes  how many share the frames; by default `jobs` of the profile

        A name of an edit stands for its film. Raises UsageError for frames of several shots.
        """
        edits = [name for name in shots if Show().names_edit(name)]
        if frames is not None and (edits or len(shots) > 1):
            fact = f"{edits[0]} is an edit, which names its own" if edits else "these are several shots"
            raise UsageError(f"-f {frames}: frames can be chosen of one shot, and {fact}; leave -f out")
        if len(edits) > 1:
            raise UsageError(f"{', '.join(edits)} are several edits, and a plan makes one film; name one")
        nothing = Store(self.root / STATE / "nothing", url=None)
        nodes, timings = nodes or self.profile.jobs, MeanTimings(self.root)
        planner = Planner(nothing, nodes, nodes, self.notes, self.profile.exported_share, timings=timings)
        far = replace(self, for_farm=True)
        for shot in shots:
            if shot in edits:
                far.add_film(planner, quality, Show().find_edit(shot))
                continue
            request = far.request(Show().find_shot(shot), quality, frames)
            planner.pictures(request)
            planner.movie(request)
        plan = planner.plan()
        return replace(plan, measured=measure_renders(self.root, plan.requests))

    def stills(
        self, shots: Sequence[str], form: str, quality: str, frames: FrameSelection | None = None
    ) -> Plan:
        """Return the plan of finished frames of shots as a display shows them, in files of a form."""
        if form not in FORMS:
            raise UsageError(f"{form!r} is not a form of stills. {suggest(form, FORMS)}")
        planner = self.planner()
        for shot in shots:
            planner.stills(self.find_request(shot, quality, frames), form)
        return planner.plan()

    def mesh_frames(self, request: RenderRequest) -> Plan:
        """Return the plan of the mesh frames of a request."""
        planner = self.planner()
        planner.simulate(request)
        return planner.plan()

    def geometry(self, request: RenderRequest) -> Plan:
        """Return the plan of the mesh frames of a request, and of its cameras."""
        planner = self.planner()
        planner.geometry(request)
        return planner.plan()

    def film(self, quality: str, path: Path = MAIN_EDIT) -> Plan:
        """Return the plan of an edit's film: its shots' frames, their movies, and the film."""
        planner = self.planner()
        self.add_film(planner, quality, path)
        return planner.plan()

    def add_film(self, planner: Planner, quality: str, path: Path = MAIN_EDIT) -> None:
        """Ask for the film of an edit, which is called as the file of the edit is, and its shots' movies."""
        edit, requests = self.edit(quality, path)
        for request in requests:
            planner.pictures(request)
            planner.movie(request)
        planner.film(edit, requests)

    def frames(self, requests: Sequence[RenderRequest]) -> Plan:
        """Return the plan of the finished frames of requests, without movies."""
        planner = self.planner()
        for request in requests:
            planner.pictures(request)
        return planner.plan()

    # Requests

    def edit(
        self, quality: str, path: Path = MAIN_EDIT, variant: str | None = None
    ) -> tuple[Edit, list[RenderRequest]]:
        """Return an edit and the render requests of its clips.

        Its shots are read only where the planning cache does not hold it. If it has a picture of its own,
        their files have folders of their own.
        """
        if path not in self._edits:
            self._edits[path] = resolve_edit(
                path, self.settings, self.cache, lambda shot, edit: self._of_edit(edit)._source(shot).manifest
            )
        edit, clips = self._edits[path].edit, self._edits[path].clips
        project = self._of_edit(edit)
        names = dict.fromkeys(shot for shot, _ in clips)
        whole = {shot: project.request(shot, quality, variant=variant) for shot in names}
        requests = [replace(whole[shot], requested=FrameRange(frames)) for shot, frames in clips]
        if edit.setting:
            requests = [replace(r, home=paths.of_edit(r.name, edit.name).as_posix()) for r in requests]
        return edit, requests

    def _of_edit(self, edit: Edit) -> Project:
        """Return the project whose shots have the picture of an edit; settings of the user come on top."""
        return replace(self, settings=(edit.setting, *self.settings)) if edit.setting else self

    def find_requests(self, name: str, quality: str) -> list[RenderRequest]:
        """Return the request of a shot, or those of the clips of an edit, by its name."""
        if Show().names_edit(name):
            return self.edit(quality, Show().find_edit(name))[1]
        return [self.request(Show().find_shot(name), quality)]

    def find_request(
        self,
        shot: str,
        quality: str,
        frames: FrameSelection | None = None,
        states: States = FrameStates.of_pictures,
        variant: str | None = None,
    ) -> RenderRequest:
        """Return the request of a shot by its name; arguments as of `request`."""
        return self.request(Show().find_shot(shot), quality, frames, variant, states)

    def request(
        self,
        path: Path,
        quality: str,
        frames: FrameSelection | None = None,
        variant: str | None = None,
        states: States = FrameStates.of_pictures,
    ) -> RenderRequest:
        """Return the request of a shot file at one quality, of all frames or those selected.

        Where only the first frames of the shot have files that they show, and those selected are among them,
        the shot ends with the last of these.

        states  the states that words such as `missing` select by; which frames they mean is settled once
        """
        if not isinstance(frames, FrameSelection | None):
            raise TypeError(f"frames are {frames!r}; FrameSelection.of_text reads text")
        require_quality(quality)
        try:
            source = self._source(path)
        except AbsentFilesError as error:
            if not isinstance(frames, FrameRange) or frames.outside(FrameRange.parse(error.present)):
                raise
            source = self._source(path, f"frames={error.present}")
        whole = FrameRange(source.manifest.frames)
        requested = frames if isinstance(frames, FrameRange) else whole
        if outside := requested.outside(whole):
            absent = f"frame {outside} is" if len(outside) == 1 else f"frames {outside} are"
            raise UsageError(
                f"{source.path}: {absent} not in the shot, which has {whole}; ask for frames among those"
            )
        chosen = variant or self.variant_of(source.name)
        request = RenderRequest(source, quality, chosen, FrameRange(dict.fromkeys(requested)))
        if not isinstance(frames, FrameWords):
            return request
        if (place := (path, quality, frames)) not in self._selected:
            self._selected[place] = select_frames(
                frames, whole, lambda: states(request, self.store, History.of(self.root))
            )
        return replace(request, requested=self._selected[place])

    def variant_of(self, shot: str) -> str:
        """Return the variant that renders a shot: one asked for, that of the profile, or one that works.

        One that is only named in the profile is not replaced by another, even if this machine lacks it:
        fetching the frames of a farm takes no GPU. Raises as `variant_for`.
        """
        on_nodes = self.for_farm or self.variant is None or not self.profile.is_local
        asked = self.variant or self.profile.variant
        return variant_for(self.root, shot, asked, self.notes.append, on_nodes)

    def known_pictures(self, request: RenderRequest) -> KnownPictures:
        """Return the states and keys of the pictures of a request, as known before anything is made."""
        return KnownPictures(request, self.store)

    def as_finished(self, request: RenderRequest) -> RenderRequest:
        """Return the request with the layers for compositing that most of its frames in renders/ have.

        `--layers` finishes frames in the same folder as without it, and the shot file does not tell. Where
        there are as many of both, or a setting names the layers, the request stays as it is.
        """
        store, places = self.store, request.places("frame", request.requested)
        is_set = any(setting.startswith("layers=") for setting in self.settings)
        shown = [] if is_set else [place for place in places if (self.root / place).exists()]
        if not shown:
            return request

        def finished(asked: RenderRequest) -> tuple[int, int]:
            keys = asked.keys.pictures(store, rendered=())
            if keys is None:
                return 0, 0
            frames = [keys[number].frame for number in asked.requested]
            seen = sum(store.shows("frame", *pair) for pair in zip(frames, places, strict=True))
            return seen, sum(store.holds("frame", frame) for frame in frames)

        if finished(request)[0] == len(shown):
            return request
        path, quality = request.source.path, request.quality_name
        alike = replace(self, settings=request.source.settings)
        others = [
            replace(
                alike.with_layers(each).request(path, quality, variant=request.variant),
                requested=request.requested,
                home=request.home,
            )
            for each in CONVENTIONS
        ]
        return max(request, *others, key=finished)

    def rendered_requests(self, path: Path) -> Iterator[RenderRequest]:
        """Yield the request of each quality, crop and scale of a shot that has a folder in renders/.

        They have the layers of their finished frames. `notes` say which crops are left out.
        """
        home = self.root / Folders.of_shot(path.stem).home
        for name in sorted(place.name for place in home.glob("*/") if QualityName.of(place.name).is_known):
            request = self.request(path, name)
            try:
                _ = request.pictures.quality
            except UsageError:
                self.notes.append(
                    f"{path.stem}: pictures of {QualityName.of(name).options} are left out; the shot's "
                    "pictures have no such part today. Repeat the --set that they were rendered with to "
                    "include them."
                )
            else:
                yield self.as_finished(request)

    def use_text(self, path: Path, text: str) -> None:
        """Use `text` as the content of the shot file at `path`, without writing it."""
        self._texts.put(path, text)

    def _source(self, path: Path, *settings: str) -> ShotSource:
        read = self._texts.source(path.absolute(), (*self.settings, *settings), self.allow_code)
        return replace(read, cache=self.cache).with_inputs()

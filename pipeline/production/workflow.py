"""What can be asked for and the plan that answers it: a shot's meshes or pictures, a turntable, the film."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.errors import MissingInputError, UsageError
from pipeline.frames import FrameRange
from pipeline.mesh.io import FORMATS
from pipeline.production.edit import Cut
from pipeline.production.layout import LOGS, PLANS
from pipeline.production.plan import Plan
from pipeline.production.planner import Planner
from pipeline.production.store import Store
from pipeline.production.take import Take, Turntable
from pipeline.production.variants import variant_for
from pipeline.shot import read_film
from render.quality import QUALITIES

SHOTS = Path("shots")
FILM = SHOTS / "film.yaml"


@dataclass(frozen=True)
class Studio:
    """A root to write to, so many cores to use; shots are looked up in `shots/` of the working folder.

    variant  the Mitsuba variant asked for; by default the first that works
    """

    root: Path
    cores: int
    variant: str | None = None

    @property
    def store(self) -> Store:
        return Store(self.root)

    def meshes(self, shots: list[str], frames: str | None = None) -> Plan:
        """The mesh frames of shots."""
        planner = self._planner()
        for shot in shots:
            planner.simulate(self.take(find_shot(shot), "draft", frames, variant="none"))
        return planner.plan()

    def pictures(self, shots: list[str], quality: str, frames: str | None = None) -> Plan:
        """Finished frames of shots, and their movies."""
        planner = self._planner()
        for shot in shots:
            take = self.take(find_shot(shot), quality, frames)
            planner.pictures(take)
            if not take.is_whole:
                self._whole_movie(planner, take)
        return planner.plan()

    def film(self, quality: str, path: Path = FILM) -> Plan:
        """The film of an edit: its shots' frames, their movies, and all of them cut together."""
        film = read_film(path)
        planner = self._planner()
        for shot in film.shots:
            assert shot.path is not None, "a film's shots come from files"
            planner.pictures(self.take(shot.path, quality))
        planner.film(Cut.of(film), quality)
        return planner.plan()

    def turntable(self, subject: str, quality: str, at: int | None, frames: int, look: str | None) -> Plan:
        """A full turn of one frame of a shot, or of a mesh file."""
        if frames < 2:
            raise UsageError(
                f"a turntable of {frames} frames does not turn; it needs at least 2, and 72 is usual"
            )
        text, path = _turntable_subject(subject, look)
        take = self._of_text(text, path, quality, None)
        first = at if at is not None else take.shot.frames.first
        if first not in take.shot.frames:
            raise UsageError(f"frame {first} is not in {take.shot.name}, which has frames {take.shot.frames}")
        turn = Turntable(first, frames)
        planner = self._planner()
        numbers = tuple(range(1, frames + 1))
        planner.pictures(Take(text, path, quality, take.variant, numbers, turn))
        return planner.plan()

    def _planner(self) -> Planner:
        return Planner(self.store, self.cores)

    def take(self, path: Path, quality: str, frames: str | None = None, variant: str | None = None) -> Take:
        """The pictures of a shot file at one quality, all or a range."""
        return self._of_text(_text(path), path, quality, frames, variant)

    def _of_text(
        self, text: str, path: Path, quality: str, frames: str | None, variant: str | None = None
    ) -> Take:
        if quality not in QUALITIES:
            raise UsageError(f"{quality!r} is not a quality; choose {', '.join(QUALITIES)}")
        whole = Take(text, path.resolve(), quality, "none", ())
        requested = FrameRange.parse(frames) if frames else whole.shot.frames
        outside = requested.outside(whole.shot.frames)
        if outside:
            raise UsageError(
                f"{path}: frames {outside} are not in the shot, which has {whole.shot.frames}; "
                f"ask for frames among those"
            )
        chosen = variant or variant_for(self.root, whole.shot.name, self.variant)
        return Take(text, path.resolve(), quality, chosen, tuple(dict.fromkeys(requested)))

    def _whole_movie(self, planner: Planner, part: Take) -> None:
        """Where a range completes a shot, its movie is due as well."""
        whole = Take(part.text, part.path, part.quality_name, part.variant, tuple(part.shot.frames))
        keys = whole.all_picture_keys(self.store)
        rest = set(whole.requested) - set(part.requested)
        if keys and all(self.store.holds("frame", keys[n].frame) for n in rest):
            planner.pictures(whole)


def plan_of(config: Mapping[str, Any], cores: int, main: bool) -> tuple[Plan, str, str]:
    """The plan a Snakefile runs, its frozen file, and the folder for what its jobs print.

    `config["plan"]` names one; without it the main process makes one of `config`'s shot, frames and
    quality (by default the film at draft), and the processes of its jobs take the latest.
    """
    root = Path.cwd()
    latest = PLANS / "latest"
    if "plan" in config:
        path = Path(str(config["plan"]))
    elif not main:
        path = Path((root / latest).read_text())
    else:
        studio, quality = Studio(root, cores), str(config.get("quality", "draft"))
        frames = str(config["frames"]) if "frames" in config else None
        plan = (
            studio.pictures([str(config["shot"])], quality, frames)
            if "shot" in config
            else studio.film(quality)
        )
        plan.restore_links(studio.store)
        path = plan.freeze(root)
        (root / latest).write_text(path.as_posix())
    plan = Plan.thaw(root / path)
    return plan, path.as_posix(), (LOGS / plan.name).as_posix()


def find_shot(name: str) -> Path:
    """The file of a shot: a path, or a name in `shots/`. Raises MissingInputError with the nearest names."""
    if name.endswith((".yaml", ".yml")):
        if not Path(name).is_file():
            raise MissingInputError(f"{name}: no such shot file; flowsculpt new makes one")
        return Path(name)
    path = SHOTS / f"{name}.yaml"
    if path.is_file():
        return path
    known = shot_names()
    near = difflib.get_close_matches(name, known, n=1) or known[:6]
    hint = f"did you mean {', '.join(near)}?" if near else "there are none; flowsculpt new makes one"
    raise MissingInputError(f"{path}: no such shot; {hint}")


def shot_names() -> list[str]:
    """The shots of the working folder."""
    return sorted(path.stem for path in SHOTS.glob("*.yaml") if path.name != FILM.name)


def _turntable_subject(subject: str, look: str | None) -> tuple[str, Path]:
    """A shot file's text and place: the one named, or one written around a mesh file."""
    suffix = Path(subject).suffix.lower()
    if suffix.lstrip(".") not in FORMATS:
        path = find_shot(subject)
        return _text(path), path
    mesh = Path(subject)
    if not mesh.is_file():
        raise MissingInputError(f"{mesh}: no such mesh file")
    lines = (
        f"title: {mesh.stem}",
        "frames: 1-1",
        f"subject: {{model: {mesh.resolve().as_posix()!r}}}",
        "resample: off",
        f"look: {look or 'clay'}",
    )
    return "\n".join(lines), mesh.with_suffix(".yaml")


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        raise UsageError(f"{path}: not UTF-8 text; save it as UTF-8") from None

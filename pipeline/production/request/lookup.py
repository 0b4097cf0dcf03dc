"""Look up what users name: shots and edits of the working folder, qualities, their crops and scales.

A crop or scale of a quality is a quality of its own, with the name `final.scale50.crop0-0-480-270`. The name
is that of its folder, and its pixels are part of the keys, so these pictures never mix with whole ones.
"""

from __future__ import annotations

import difflib
import math
import re
import shlex
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from flowsculpt.pipeline.errors import MissingInputError, UsageError, suggest
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.shot.yaml.named_files import DEFAULTS, is_edit, name_fault, quote_name, shot_files
from flowsculpt.pipeline.shot.yaml.synonyms import value_meant
from flowsculpt.render.base.input_files import InputFile, kind_of_path
from flowsculpt.render.scene.render_quality import FORMER_NAMES, QUALITIES, Crop, Quality

if TYPE_CHECKING:  # reading shots takes a second
    from flowsculpt.pipeline.shot import Film

LEAST, MOST = 1.0, 400.0
"""Limits of `--scale`, per cent."""

_NAME = re.compile(r"(\w+)(?:\.scale(\d+(?:\.\d+)?))?(?:\.crop(\d+)-(\d+)-(\d+)-(\d+))?")


class QualityName(NamedTuple):
    """What the name of a quality, or of a crop or scale of one, says: `final.scale50.crop0-0-480-270`.

    scale  per cent, as the name has it; empty for pictures of the usual size
    crop   pixels; None for whole pictures
    """

    base: str
    scale: str
    crop: Crop | None

    @classmethod
    def of(cls, name: str) -> QualityName:
        """Return what a name says; any other text is the name of an unknown quality."""
        match = _NAME.fullmatch(name)
        if match is None:
            return cls(name, "", None)
        base, scale, *crop = match.groups()
        x0, y0, x1, y1 = (int(edge or 0) for edge in crop)
        return cls(base, scale or "", (x0, y0, x1, y1) if crop[0] else None)

    @staticmethod
    def names() -> tuple[str, ...]:
        """Return the names of the qualities that every shot has, the quickest first."""
        return tuple(QUALITIES)

    @property
    def is_known(self) -> bool:
        """True if there is such a quality."""
        return self.base in QUALITIES

    @property
    def options(self) -> str:
        """The options that ask for it: `-q draft --scale 50%`."""
        options = [f"-q {self.base}"]
        options += [f"--scale {self.scale}%"] if self.scale else []
        options += [f"--crop {','.join(map(str, self.crop))}"] if self.crop else []
        return " ".join(options)


def cropped_name(
    quality: str,
    crop: str | None = None,
    scale: str | None = None,
    qualities: Mapping[str, Quality] = QUALITIES,
) -> str:
    """Return the name of a quality's crop or scale. Raises UsageError where an option is wrong.

    qualities  those of the shot: the pixels of a crop are part of its name
    """
    if quality not in QUALITIES:
        return quality  # whoever looks it up tells that it is unknown
    name = quality
    if scale is not None and (per_cent := _per_cent(scale)) != 100.0:
        name += f".scale{per_cent:g}"
    if crop is not None:
        whole = quality_named(name, qualities)
        name += ".crop" + "-".join(map(str, _pixels(crop, whole.width, whole.height)))
    return name


def today_name(name: str) -> str:
    """Return the name of a quality, or of a crop or scale of one, as it is today: draft for preview."""
    base = QualityName.of(name).base
    return FORMER_NAMES.get(base, base) + name[len(base) :]


def require_quality(name: str) -> None:
    """Raise UsageError, with the nearest one, for what is no quality."""
    if not QualityName.of(name).is_known:
        meant = value_meant(name, QUALITIES)
        hint = f"Did you mean {meant!r}?" if meant else suggest(name, QUALITIES)
        raise UsageError(f"{name!r} is not a quality. {hint}")


def quality_named(name: str, qualities: Mapping[str, Quality]) -> Quality:
    """Return the quality of a name that `cropped_name` gave, by the qualities of a shot.

    Raises UsageError for a crop of larger pictures than those of the shot.
    """
    base, scale, crop = QualityName.of(name)
    quality = qualities[base]
    if scale:
        size = (max(1, round(side * float(scale) / 100.0)) for side in (quality.width, quality.height))
        width, height = size
        quality = replace(quality, width=width, height=height)
    if crop:
        if crop[2] > quality.width or crop[3] > quality.height:
            raise UsageError(
                f"crop {','.join(map(str, crop))} goes beyond the picture, which has {quality.width} × "
                f"{quality.height} pixels. Crop pictures of one size at a time."
            )
        quality = replace(quality, crop=crop)
    return quality


def pixels(name: str) -> int:
    """Return the pixels that the quality of a name renders of 16:9 pictures; of a crop, of any."""
    if crop := QualityName.of(name).crop:
        x0, y0, x1, y1 = crop
        return (x1 - x0) * (y1 - y0)
    named = quality_named(name, QUALITIES)
    return named.width * named.height


def movie_bits(name: str) -> int:
    """Return the bits of a movie's samples: 10 keep gradients smooth, 8 play everywhere."""
    return 10 if QualityName.of(name).base == "final" else 8


def _per_cent(text: str) -> float:
    """Parse `50%` or `0.5`."""
    try:
        number = float(text.removesuffix("%")) * (1.0 if text.endswith("%") else 100.0)
    except ValueError:
        number = math.nan
    if not LEAST <= number <= MOST:
        meant = f"{text}%" if MOST < number <= 100.0 * MOST and "%" not in text else "50%, or 0.5"
        raise UsageError(f"--scale {text} is out of range ({LEAST:g}–{MOST:g}%). Write {meant}.")
    return float(f"{number:.4g}")


def _pixels(text: str, width: int, height: int) -> Crop:
    """Parse `x0,y0,x1,y1`: fractions of the picture if none is above 1, else pixels; round outwards."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 4 or not all(math.isfinite(number) for number in numbers):
        raise UsageError(
            f"--crop {text} is not a part of the picture; write the left, upper, right and lower edge, in "
            "pixels or as fractions of the picture: --crop 0.25,0.25,0.75,0.75"
        )
    if max(numbers) <= 1.0:
        numbers = [number * side for number, side in zip(numbers, (width, height) * 2, strict=True)]
    x0, y0 = (math.floor(number + 1e-6) for number in numbers[:2])
    x1, y1 = (math.ceil(number - 1e-6) for number in numbers[2:])
    if x1 <= x0 or y1 <= y0:
        raise UsageError(
            f"--crop {text} is {max(0, x1 - x0)} × {max(0, y1 - y0)} pixels large; the right edge must lie "
            "beyond the left one, and the lower beyond the upper. Correct them."
        )
    if x0 < 0 or y0 < 0 or x1 > width or y1 > height:
        raise UsageError(
            f"--crop {text} goes beyond the picture, which has {width} × {height} pixels. Keep within."
        )
    return x0, y0, x1, y1


OTHER_MODELS = ("3ds", "ac", "bgeo", "blend", "lwo", "ma", "max", "mb", "vrml", "wrl", "x3d")
"""Endings of model files of formats that are not read, for the message to one who names such a file."""


def _require_name(path: Path, kind: str) -> None:
    """Raise UsageError for a name that no shot or edit can have."""
    if fault := name_fault(path.stem, kind):
        raise UsageError(f"{quote_name(path)}: {fault}")


def _near(name: str, known: list[str], otherwise: str) -> str:
    near = difflib.get_close_matches(name, known, n=1) or known[:6]
    return f"did you mean {', '.join(near)}?" if near else f"there are none; {otherwise}"


@dataclass(frozen=True)
class Show:
    """The shots and edits of a folder, by default of `shots/` in the working folder."""

    folder: Path = Path("shots")

    @property
    def film(self) -> Path:
        """The file of its main edit."""
        return self.folder / "film.yaml"

    def find_shot(self, name: str) -> Path:
        """Return the file of a shot: a path, or a name in `shots/`.

        Raises MissingInputError with the nearest names, UsageError for a name that no frames can have.
        """
        is_model = Path(name).suffix.lower().lstrip(".") in plugins().readers("surface")
        if is_model and not InputFile(self.folder / f"{name}.yaml").is_there():
            own = re.sub(r"[^A-Za-z0-9_-]", "_", Path(name).stem)
            raise UsageError(
                f"{quote_name(name)} is a model, not a shot; flowsculpt new A010_{own} --model "
                f"{shlex.quote(quote_name(name))} makes a shot of it"
            )
        if Path(name).suffix.lower().lstrip(".") in OTHER_MODELS:
            raise UsageError(
                f"{quote_name(name)} is in a format that is not supported; export the model as FBX, GLB, OBJ "
                "or USD"
            )
        path = self._path(name)
        if is_edit(path):
            own = "" if path == self.film else f" {quote_name(name)}"
            raise UsageError(f"{quote_name(path)} is an edit, not a shot; flowsculpt film{own} renders it")
        _require_name(path, "shot")
        if InputFile(path).is_there():
            return path
        if kind := kind_of_path(path):
            raise MissingInputError(
                f"{quote_name(path)}: it is {kind}; a shot is a regular file. Remove or rename it."
            )
        if path == Path(name):
            hint = f"did you mean {path.stem}?" if path.stem in self.shots() else "flowsculpt new makes one"
            raise MissingInputError(f"{quote_name(name)}: no such shot file; {hint}")
        if name in (known := self.misnamed()):
            raise MissingInputError(f"{quote_name(path)}: no such shot; {known[name]}")
        self.require_shots()
        raise MissingInputError(
            f"{quote_name(path)}: no such shot; {_near(name, self.shots(), 'flowsculpt new makes one')}"
        )

    def find_edit(self, name: str) -> Path:
        """Return the file of an edit: a path, or a name in `shots/`.

        Raises MissingInputError with the nearest names, UsageError for a shot, and for a name that no film
        can have.
        """
        path = self._path(name)
        _require_name(path, "edit")
        hint = _near(path.stem, self.edits(), "flowsculpt new --show writes shots/film.yaml")
        if not InputFile(path).is_there():
            self.require_shots()
            raise MissingInputError(f"{quote_name(path)}: no such edit; {hint}")
        if path.stem in self.shots() and path.absolute() == (self.folder / path.name).absolute():
            raise UsageError(
                f"{quote_name(path)} is a shot, not an edit; flowsculpt render {path.stem} renders it, "
                f"and as for edits, {hint}"
            )
        return path

    def check_edit(self, name: str, settings: Iterable[str] = ()) -> Film:
        """Read an edit with its shots, which take the settings. Raises as `find_edit`, and ShotError."""
        from flowsculpt.pipeline.shot import read_film

        return read_film(self.find_edit(name), settings)

    @property
    def defaults(self) -> Path:
        """The file that holds defaults for all shots."""
        return self.folder / DEFAULTS

    @staticmethod
    def name_fault(name: str) -> str | None:
        """Return rule and remedy for a name that a shot cannot have; None for a good one."""
        return name_fault(name)

    def names_edit(self, name: str) -> bool:
        """Tell whether a name, or a path, is that of an edit."""
        path = self._path(name)
        return path == self.film or is_edit(path)

    def shots(self) -> list[str]:
        """Return the names of the shots."""
        files = shot_files(self.folder)
        return [path.stem for path in files if path.name != self.film.name and not is_edit(path)]

    def edits(self) -> list[str]:
        """Return the names of the edits; `film` is always an edit."""
        return [path.stem for path in shot_files(self.folder) if path == self.film or is_edit(path)]

    def misnamed(self) -> dict[str, str]:
        """Return files that only their suffix keeps from being shots, with the remedy."""
        return {
            path.stem: f"{quote_name(path)} is passed over: shots end in .yaml. "
            f"Rename it to {path.stem}.yaml."
            for path in sorted(self.folder.glob("[!.]*"))
            if path.suffix != ".yaml" and path.suffix.lower() in (".yaml", ".yml")
        }

    def require_shots(self) -> None:
        """Raise UsageError where no shot was begun yet."""
        if not self.shots() and not self.edits():
            raise UsageError(
                f"{self.folder.resolve()}: no shots are here; they are read from the folder that you are in, "
                "whatever --root is. Go to the folder above shots/, or begin: `flowsculpt new A010_first` "
                "writes one, `flowsculpt new --show` a show with its first shot and its edit."
            )

    def _path(self, name: str) -> Path:
        """Return the path of a shot or an edit."""
        return Path(name) if name.endswith((".yaml", ".yml")) else self.folder / f"{name}.yaml"

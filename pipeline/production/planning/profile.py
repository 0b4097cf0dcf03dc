"""The profile that says where jobs run, this machine or a farm, and the Mitsuba variant of each shot.

A profile is a folder with `profile.yaml` (or `config.yaml`): settings of Snakemake and of the executor plugin
it names, passed to Snakemake unchanged. Planning reads how many jobs the farm takes at once (`jobs`), and
under `config` the cores of a job (`threads`), the fewest of its frames (`min_frames`), and the Mitsuba
variant of its nodes (`variant`).

A shot is rendered by the first variant that works on this machine and has not failed on the shot. A GPU is
used if it is asked for and works. If it fails, the whole shot falls back to a variant for processors. The
variant is part of every picture's key, so pictures of two variants never stand in one shot. One that is named
for the nodes of a farm is not tried on the machine that plans: each node does so before it renders, and says
what it lacks.
"""

from __future__ import annotations

import json
import platform
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from flowsculpt.pipeline.errors import MachineError, MissingInputError, UsageError, suggest
from flowsculpt.pipeline.production.store.paths import STATE
from flowsculpt.render.base.atomic_write import write_text
from flowsculpt.render.base.python_process import command_line
from flowsculpt.render.base.state_files import mapping, read_state
from flowsculpt.render.mitsuba.engine import DEFAULT_ORDER, GPU_VARIANTS, VARIANTS, choose, works
from flowsculpt.render.mitsuba.llvm import OLDEST_VERSION

PROFILES = Path("profiles")

LOCAL = "local"

SIDE_BY_SIDE = 100
"""Default of `jobs`: jobs that a farm gets at once."""

THREADS = 4
"""Default of `threads`: cores of a job on a farm."""

START_OF_JOB, START_OF_TASK = 12.0, 3.0
"""Seconds that a node takes to start a job of Snakemake, on SLURM 5 to 12, and a task of a render manager."""


@dataclass(frozen=True)
class Share:
    """The size of a job on a farm.

    threads  its cores
    frames   fewest of its frames; None for so many that they take as long as its start
    start    seconds that a node takes to start it
    """

    threads: int
    frames: int | None = None
    start: float = START_OF_JOB

    @classmethod
    def of(cls, settings: Mapping[str, Any], source: str = "--config") -> Share:
        """Read the `config` of a profile. Raises UsageError for what is no whole number from 1 on."""
        threads, least = settings.get("threads"), settings.get("min_frames")
        frames = None if least is None else _whole(source, "min_frames", least, 1)
        return cls(_whole(source, "threads", threads, THREADS), frames)


@dataclass(frozen=True)
class Profile:
    """One profile: the folder it lies in."""

    folder: Path

    @classmethod
    def named(cls, name: str) -> Profile:
        """Find a profile by name, among the shipped ones or in `profiles/` of the working folder, or by path.

        A profile holds commands that submit jobs. So one of a show never takes the name of a shipped one.
        Raises MissingInputError where there is none.
        """
        for folder in (shipped() / name, PROFILES / name, Path(name)):
            if _file_in(folder) is not None:
                return cls(folder.absolute())
        known = sorted(
            {path.name for place in (PROFILES, shipped()) for path in place.glob("*") if _file_in(path)}
        )
        raise MissingInputError(
            f"{name}: no such profile; a profile is a folder with profile.yaml: one that is shipped, one in "
            f"{PROFILES}/, or a path. "
            f"{suggest(name, [other for other in known if other != 'default'])} docs/farm.md has examples "
            "for PBS, Grid Engine, LSF and HTCondor."
        )

    @property
    def hides(self) -> Path | None:
        """The working folder's own profile of the same name, which is used only where its path is given."""
        own = PROFILES / self.folder.name
        is_shipped = self.folder.parent == shipped() and own.absolute() != self.folder
        return own if is_shipped and _file_in(own) is not None else None

    @classmethod
    def local(cls) -> Profile:
        """Return the shipped profile for this machine."""
        return cls(shipped() / LOCAL)

    @property
    def is_local(self) -> bool:
        """True if jobs run on this machine and share its cores."""
        return self.executor == LOCAL

    @property
    def executor(self) -> str:
        """The executor that the profile names. Raises where its plugin is not installed."""
        executor = self._said.get("executor") or LOCAL
        if not isinstance(executor, str):
            raise UsageError(f"{self._file}: executor is {executor!r}; it must be a name, such as slurm")
        package = f"snakemake-executor-plugin-{executor}"
        if executor not in _BUILT_IN and find_spec(package.replace("-", "_")) is None:
            raise MachineError(
                f"{self._file}: executor {executor} needs the package {package}, which is not installed; "
                f"install it for the Python of flowsculpt: {command_line('pip', 'install', package)}"
            )
        return executor

    def side_by_side(self, cores: int) -> int:
        """Return how many jobs run at once on a machine with so many cores, or on the farm."""
        return cores if self.is_local else self.jobs

    @property
    def jobs(self) -> int:
        """Return how many jobs a farm gets at once."""
        return _whole(str(self._file), "jobs", self._said.get("jobs"), SIDE_BY_SIDE)

    @property
    def share(self) -> Share | None:
        """The size of each job; None where jobs share this machine's cores."""
        return None if self.is_local else self._share

    @property
    def exported_share(self) -> Share:
        """The size of each task of an exported job, for which a profile without an executor speaks too."""
        return replace(self._share, start=START_OF_TASK)

    @property
    def _share(self) -> Share:
        if "frames" in self._config:
            raise UsageError(f"{self._file}: config: frames is called min_frames; rename it")
        return Share.of(self._config, f"{self._file}: config")

    @property
    def variant(self) -> str | None:
        """The Mitsuba variant that renders on the farm's nodes; None where the profile names none."""
        variant = self._config.get("variant")
        if variant is not None and variant not in VARIANTS:
            raise UsageError(
                f"{self._file}: config: variant is {variant!r}, which Mitsuba does not have. "
                f"{suggest(str(variant), VARIANTS)}"
            )
        return variant

    @property
    def _config(self) -> dict[str, Any]:
        said = self._said.get("config")
        return said if isinstance(said, dict) else {}

    @property
    def arguments(self) -> list[str]:
        """The arguments that pass the profile to Snakemake."""
        there = ["--profile", str(self._file)]
        return there if self.is_local or "jobs" in self._said else [*there, "--jobs", str(SIDE_BY_SIDE)]

    @property
    def _file(self) -> Path:
        file = _file_in(self.folder)
        assert file is not None, "a profile is made of a folder that has one"
        return file

    @cached_property
    def _said(self) -> dict[str, Any]:
        """Raises UsageError where it cannot be read."""
        from ruamel.yaml import YAML  # takes time to import, and most runs are on this machine
        from ruamel.yaml.error import YAMLError

        try:
            said = YAML(typ="safe", pure=True).load(self._file.read_text(encoding="utf-8")) or {}
        except OSError as error:
            raise MissingInputError(f"{self._file}: cannot be read ({error.strerror})") from None
        except (YAMLError, UnicodeDecodeError) as error:
            fact = " ".join(str(error).split())
            raise UsageError(f"{self._file}: not a profile ({fact})") from None
        if not isinstance(said, dict):
            raise UsageError(
                f"{self._file}: not a profile; it must be names and values, such as `executor: slurm`"
            )
        return said


def _whole(source: str, name: str, said: Any, default: int) -> int:
    if said is None or said == "unlimited":
        return default
    if isinstance(said, bool) or not isinstance(said, int) or said < 1:
        raise UsageError(f"{source}: {name} is {said!r}; it must be a whole number of at least 1")
    return said


_BUILT_IN = ("local", "dryrun", "touch")


def shipped() -> Path:
    """The profiles of the checkout, or those shipped in the wheel."""
    here = Path(__file__).parents
    for place in (here[3] / PROFILES, here[1] / "profiles"):
        if (place / "default").is_dir():
            return place
    raise MachineError("no profiles beside the package; install flowsculpt again")


def _file_in(folder: Path) -> Path | None:
    """Snakemake's own names; a file for a later version of it is none of ours."""
    files = (folder / name for name in ("profile.yaml", "config.yaml"))
    return next((file for file in files if file.is_file()), None)


_LACKING = {
    "cuda_ad_rgb": "Mitsuba finds no NVIDIA GPU with a driver that it can use",
    "metal_ad_rgb": "Mitsuba finds no Apple GPU that it can use",
    "llvm_ad_rgb": f"it has no libLLVM of version {OLDEST_VERSION} or later that works; on Debian and Ubuntu "
    "`python -m flowsculpt.render.mitsuba.engine` there fetches one",
}
"""Reasons why a machine cannot use a variant, by variant."""


class VariantError(MachineError):
    """Raised where a node cannot render with the variant of its plan."""


def require_variant(variant: str) -> None:
    """Raise VariantError, with the name of this machine, where it cannot render with a plan's variant."""
    try:
        choose([variant])
    except MachineError:
        lacking = _LACKING.get(variant, "a sample does not render; `flowsculpt doctor` there says more")
        raise VariantError(
            f"{platform.node()} cannot render with {variant}, the variant of this plan: {lacking}. Keep its "
            "jobs off this node, or name another variant by --variant or in the profile's config, and plan "
            "again"
        ) from None


def variant_for(
    root: Path,
    shot: str,
    asked: str | None = None,
    tell: Callable[[str], None] = print,
    on_nodes: bool = False,
) -> str:
    """Return the variant that renders `shot`: the one asked for, or the first that works here.

    tell      called with a line that says why another variant replaces a GPU
    on_nodes  nodes of a farm render: a variant asked for need not work here

    Raises UsageError for a variant that is not known, MachineError where none works, MachineError where
    another one asked for has failed.
    """
    avoided = _avoided(root, shot)
    if asked is None:
        return _first_but(avoided)
    if on_nodes and asked not in avoided:
        if asked not in VARIANTS:
            raise UsageError(f"{asked!r} is not a variant of Mitsuba. {suggest(asked, VARIANTS)}")
        return asked
    if asked in GPU_VARIANTS and (asked in avoided or not _gpu_works(asked)):
        absent = f"{asked} cannot render here: {_LACKING[asked]}"
        chosen = _first_but(avoided)
        tell(f"{avoided.get(asked, absent)}; {shot} is rendered with {chosen} instead")
        return chosen
    if asked in avoided:
        raise MachineError(f"{avoided[asked]}; leave out --variant to have another one chosen")
    return choose([asked]).variant


def _first_but(avoided: Mapping[str, str]) -> str:
    return _first_of(tuple(v for v in DEFAULT_ORDER if v not in avoided))


@cache
def _first_of(order: tuple[str, ...]) -> str:
    """Ask once a process, not for every shot."""
    return choose(order or None).variant


@cache
def _gpu_works(variant: str) -> bool:
    """Ask once a process; a failure is not stored, for a driver may be installed."""
    return works(variant)


def avoid(root: Path, shot: str, variant: str, reason: str) -> bool:
    """Remember that a variant failed on a shot; return True if another is left to try."""
    path = _memory(root, shot)
    known = {**_avoided(root, shot), variant: reason}
    write_text(path, json.dumps({"mitsuba": version("mitsuba"), "avoid": known}))
    return any(v not in known for v in DEFAULT_ORDER)


def _avoided(root: Path, shot: str) -> dict[str, str]:
    """Return the variants that failed on this shot and the reasons; a new Mitsuba gets a new chance."""
    memory = read_state(_memory(root, shot), mapping) or {}
    avoided = memory.get("avoid") if memory.get("mitsuba") == version("mitsuba") else None
    return {name: str(why) for name, why in avoided.items()} if isinstance(avoided, dict) else {}


def _memory(root: Path, shot: str) -> Path:
    return root / STATE / "variants" / f"{shot}.json"

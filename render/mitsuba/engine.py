"""Choose Mitsuba's variant: compiled by LLVM, scalar, or on a GPU on request.

A variant that cannot run may end the whole process, and only at its first render. So each is probed by
rendering one sample in a process of its own; the answer is stored in the disk cache.
"""

from __future__ import annotations

import os
import platform
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

from flowsculpt.render.base import python_process
from flowsculpt.render.base.render_errors import BadInputError, MachineError
from flowsculpt.render.base.user_cache import CachedAnswer, intruder, writable_cache
from flowsculpt.render.mitsuba import llvm
from flowsculpt.render.mitsuba.llvm import LibLlvm

DEFAULT_ORDER = ("llvm_ad_rgb", "scalar_rgb")
GPU_VARIANTS = ("cuda_ad_rgb", "metal_ad_rgb")
"""NVIDIA's GPUs, and Apple's: packages of Mitsuba have the one or the other, by their system."""

VARIANTS = (*GPU_VARIANTS, *DEFAULT_ORDER)
PROBE_SECONDS = 120.0

CRASHES = {-number for number in signal.Signals if number.name in ("SIGABRT", "SIGBUS", "SIGILL", "SIGSEGV")}
"""Exit codes of a crash. Other signals come from outside and say nothing about the variant."""


@dataclass(frozen=True)
class Engine:
    """A variant of Mitsuba that works on this machine.

    variant   Mitsuba's name
    threads   their number; 0 is one per core
    why       reason for the choice, for `doctor`
    faster    advice how to render faster here, or ""
    llvm      the library that the variant needs, or None
    """

    variant: str
    threads: int = 0
    why: str = ""
    faster: str = ""
    llvm: LibLlvm | None = None

    def start(self) -> None:
        """Set Mitsuba's variant and thread count in this process and thread. Once is enough.

        Raises MachineError where another variant runs already: pictures of two variants differ, and one shot
        never mixes them.
        """
        if self.llvm is not None and os.environ.get(llvm.ENVIRONMENT_NAME) != str(self.llvm.path):
            if "drjit" in sys.modules:
                raise MachineError(
                    "Mitsuba was imported before its engine was started and may have taken a libLLVM that "
                    "crashes; start the engine first"
                )
            self.llvm.load()
        _trust_compiled_code()
        import drjit as dr
        import mitsuba as mi

        current = mi.variant()
        if current not in (None, self.variant):
            raise MachineError(
                f"this process renders with {current} and cannot change to {self.variant}; start another"
            )
        if current is None:
            mi.set_variant(self.variant)
            mi.set_log_level(mi.LogLevel.Error)
            files: Any = mi.file_resolver()  # type: ignore[operator]  # its stub is wrong
            files.clear()  # it begins with the working folder, whose plugins/path.so would be run
            files.append(str(Path(mi.__file__).parent))
        threads = self.threads or available_cores()
        if dr.thread_count() != threads:
            dr.set_thread_count(threads)

    def facts(self) -> dict[str, Any]:
        """Return the facts that a picture's header records."""
        return {"variant": self.variant, "mitsuba": _mitsuba_version()}


@cache
def _mitsuba_version() -> str:
    """Return the version that is installed, which takes a millisecond to find."""
    return version("mitsuba")


def _trust_compiled_code() -> None:
    """Have Dr.Jit keep compiled code where it can write, and where nobody else can have put some."""
    if "DRJIT_CACHE_DIR" in os.environ or not os.environ.get("HOME"):  # without, it keeps none
        return
    folder = Path(os.environ["HOME"]) / ".drjit"
    place = folder if folder.exists() else folder.parent
    if intruder(place) or not os.access(place, os.W_OK):
        os.environ["DRJIT_CACHE_DIR"] = str(writable_cache() / "drjit")


def choose(prefer: Sequence[str] | None = None, threads: int = 0) -> Engine:
    """Return the first variant of `prefer` (default: LLVM, then scalar) that renders a sample here.

    A GPU is used only if `prefer` names its variant. Raises BadInputError for an unknown variant,
    MachineError where none works.
    """
    order = tuple(prefer) if prefer else DEFAULT_ORDER
    for variant in order:
        if variant not in VARIANTS:
            raise BadInputError(f"{variant!r} is not a renderer; it can be {', '.join(VARIANTS)}")
    refused: list[str] = []
    for variant in order:
        libraries: list[LibLlvm | None] = [*llvm.candidates()] if variant == "llvm_ad_rgb" else [None]
        for library in libraries:
            if works(variant, library):
                why = f"renders a sample with {library.path}" if library else "renders a sample"
                why += f"; {', '.join(refused)} did not" if refused else ""
                return Engine(variant, threads, why, _faster(variant), library)
        refused.append(variant)
    raise MachineError(
        f"none of {', '.join(order)} can render a sample here; run `flowsculpt doctor` or allow scalar_rgb"
    )


def working_llvm() -> LibLlvm | None:
    """Return the libLLVM that `choose` would use, or None."""
    return next((library for library in llvm.candidates() if works("llvm_ad_rgb", library)), None)


def provide_llvm() -> None:
    """Fetch a libLLVM where none works and one can be had. Never fails: rendering works without.

    Set-up runs it: ``python -m flowsculpt.render.mitsuba.engine``.
    """
    folder = llvm.provisioned_folder()
    try:
        if working_llvm() is None:
            package = llvm.provision(folder)
            library = working_llvm()
            if library is None:
                shutil.rmtree(folder, ignore_errors=True)
                raise MachineError(f"{package} does not work here")
            print(
                f"libLLVM {library.version or ''} unpacked from {package}: fast rendering on this machine",
                file=sys.stderr,
            )
    except MachineError as error:
        print(
            f"No libLLVM fetched ({error}): rendering works without it, at about half the speed",
            file=sys.stderr,
        )


def is_compiled() -> bool:
    """Tell whether the variant that this process has started compiles code."""
    import mitsuba as mi

    return mi.variant() != "scalar_rgb"


def works(variant: str, library: LibLlvm | None = None) -> bool:
    """Tell whether one sample renders, in a process of its own. Cached by machine, version and library."""
    cached = _cache_file(variant, library)
    known = cached.load(lambda stored: stored["works"])
    if isinstance(known, bool):
        return known
    answer = _probe(variant, library)
    if answer is not None and (answer or variant not in GPU_VARIANTS):  # a driver may be installed later
        cached.store({"works": answer, "variant": variant, "library": str(library and library.path)})
    return bool(answer)


def available_cores() -> int:
    """Return the cores that this process may use, which a container or a farm may limit."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # macOS and Windows have no affinity
        return os.cpu_count() or 1


def facts() -> dict[str, str]:
    """Return what `doctor` reports on rendering: the variant, the reason for it, and advice."""
    try:
        engine = choose()
    except MachineError as error:
        return {"renderer": "none", "why": str(error), "faster": ""}
    return {
        "renderer": f"Mitsuba {version('mitsuba')}, {engine.variant}, {available_cores()} threads",
        "why": engine.why,
        "faster": engine.faster,
    }


def _faster(variant: str) -> str:
    if variant != "scalar_rgb":
        return ""
    return (
        f"a libLLVM of version {llvm.OLDEST_VERSION} or later, about twice: "
        f"`python -m flowsculpt.render.mitsuba.engine` on Debian and Ubuntu, else install it and set "
        f"{llvm.ENVIRONMENT_NAME}"
    )


def _probe(variant: str, library: LibLlvm | None) -> bool | None:
    """Return whether one sample rendered, or None if the probe timed out or was killed from outside."""
    files = [library.path, *library.dependencies] if library is not None else []
    try:
        done = subprocess.run(
            python_process.python_command("flowsculpt.render.mitsuba.engine", variant, *map(str, files)),
            env=python_process.environment(),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=PROBE_SECONDS,
        )
    except (subprocess.TimeoutExpired, OSError):
        return None
    if done.returncode < 0 and done.returncode not in CRASHES:
        return None
    return done.returncode == 0


def _cache_file(variant: str, library: LibLlvm | None) -> CachedAnswer:
    """Return the cache file of the answer."""
    parts = [variant, version("mitsuba"), version("drjit"), sys.version, sys.prefix]
    parts += [platform.node(), platform.machine()]
    if library is not None:
        try:
            facts = library.path.stat()
            parts += [str(library.path), str(facts.st_size), str(facts.st_mtime_ns)]
        except OSError:
            parts.append(f"{library.path} missing")
    return CachedAnswer.of("engine", parts)


def probe(arguments: Sequence[str]) -> int:
    """Probe in this process: VARIANT [LIBRARY DEPENDENCY…]. Return 0 if a sample is brighter than black."""
    variant, *files = arguments
    paths = [Path(file) for file in files]
    library = LibLlvm(paths[0], tuple(paths[1:])) if paths else None
    Engine(variant, threads=1, llvm=library).start()
    import mitsuba as mi
    import numpy as np

    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 3},
            "sensor": {
                "type": "perspective",
                "film": {"type": "hdrfilm", "width": 4, "height": 4, "rfilter": {"type": "box"}},
                "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 4], target=[0, 0, 0], up=[0, 1, 0]),
            },
            "ball": {"type": "sphere"},
            "sky": {"type": "constant"},
        },
        parallel=False,
    )
    return 0 if float(np.array(mi.render(scene, spp=1, seed=1)).mean()) > 0.0 else 1


if __name__ == "__main__":
    if sys.argv[1:]:
        # os._exit: a crash in a library's clean-up must not count as a failed render.
        os._exit(probe(sys.argv[1:]))
    provide_llvm()

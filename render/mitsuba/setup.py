"""Set-up's step for rendering: provide a libLLVM where none works. ``python -m render.mitsuba.setup``."""

from __future__ import annotations

import shutil

from render.base.errors import MachineError
from render.mitsuba import engine, llvm


def main() -> None:
    """Make sure that a working libLLVM is there, if one can be had. Never fails: rendering works without."""
    folder = llvm.provisioned_folder()
    try:
        if engine.working_llvm() is None:
            package = llvm.provision(folder)
            library = engine.working_llvm()
            if library is None:
                shutil.rmtree(folder, ignore_errors=True)
                raise MachineError(f"{package} does not work here")
            print(f"libLLVM {library.version or ''} unpacked from {package}: fast rendering on this machine")
    except MachineError as error:
        print(f"No libLLVM fetched ({error}): rendering works without, at about half the speed")


if __name__ == "__main__":
    main()

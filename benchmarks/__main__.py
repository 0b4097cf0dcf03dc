"""Run all benchmarks: `python -m benchmarks`.

Those that need a package which only `make test` installs are left out without it, and named.
"""

from importlib import import_module
from importlib.util import find_spec

from benchmarks import (
    bare,
    breeding,
    flows,
    found_models,
    orchestration,
    pictures,
    polyhedra,
    preview,
    renewal,
    resampling,
    seams,
)

NEEDS = {"interchange": "pxr", "remote_store": "moto"}
"""Benchmarks, and the module that each needs beside the project's own packages."""

if __name__ == "__main__":
    resampling.main()
    seams.main()
    renewal.main()
    polyhedra.main()
    flows.main()
    pictures.main()
    bare.main()
    orchestration.main()
    preview.main()
    breeding.main()
    found_models.main()
    for name, module in NEEDS.items():
        if find_spec(module) is None:
            print(f"\n{name} is left out: there is no module {module}; make test installs it")
        else:
            import_module(f"benchmarks.{name}").main()

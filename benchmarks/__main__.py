"""Run all benchmarks: `python -m benchmarks`.

Those that need a package which only `make test` installs, or a plug-in, are left out without it, and named.
"""

from importlib import import_module

NAMES = (
    "resampling",
    "seams",
    "renewal",
    "polyhedra",
    "flows",
    "pictures",
    "bare",
    "orchestration",
    "preview",
    "breeding",
    "found_models",
    "interchange",
    "remote_store",
)

if __name__ == "__main__":
    for name in NAMES:
        try:
            benchmark = import_module(f"benchmarks.{name}")
        except ModuleNotFoundError as error:
            print(f"\n{name} is left out, because the module {error.name} is missing")
        else:
            benchmark.main()

"""Write `flowsculpt/**/*.pyi`, by which type checkers and editors find the modules of a checkout.

They read paths, and run no code: of `flowsculpt.pipeline.shot` they look for a file below `flowsculpt/`. Each
of these files takes the names of the module of that path from beside it. Python itself does not read them,
the wheel has none, and git ignores them.
"""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGES = ("pipeline", "render")


def write_stubs() -> None:
    """Write a stub for each module, and remove those of modules that are gone."""
    stubs = {}
    for package in PACKAGES:
        for source in (ROOT / package).rglob("*.py"):
            module = source.relative_to(ROOT).with_suffix("")
            name = ".".join(module.parts).removesuffix(".__init__")
            stubs[ROOT / "flowsculpt" / module.with_suffix(".pyi")] = f"from {name} import *\n"
    written = {path for package in PACKAGES for path in (ROOT / "flowsculpt" / package).rglob("*.pyi")}
    for path in written - stubs.keys():
        path.unlink()
    for path, text in stubs.items():
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write_stubs()

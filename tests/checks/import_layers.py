"""Check which module may import which, from the root: no circles, and the contracts in pyproject.toml.

import-linter takes a package below another one for a mistake, unless the outer one is a namespace.
`flowsculpt` is none, since it has names itself; and its packages lie beside it, where Python alone finds
them.
"""

from __future__ import annotations

import sys
from graphlib import CycleError, TopologicalSorter
from importlib.util import find_spec

from grimp import build_graph
from grimp.application.config import settings
from grimp.application.ports.packagefinder import AbstractPackageFinder
from importlinter.cli import lint_imports_command


class ImportedPackages(AbstractPackageFinder):
    """Finds packages where Python does."""

    def determine_package_directories(self, package_name: str, file_system: object) -> set[str]:
        spec = find_spec(package_name)
        if spec is None or spec.submodule_search_locations is None:
            raise ValueError(f"{package_name} is not a package")
        return set(spec.submodule_search_locations)


def circle() -> list[str]:
    """Return modules of which each imports the next, and the last is the first; none where there is none.

    Imports for types alone do not count.
    """
    graph = build_graph("flowsculpt.pipeline", "flowsculpt.render", exclude_type_checking_imports=True)
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return list(error.args[1][::-1])
    return []


if __name__ == "__main__":
    settings.configure(PACKAGE_FINDER=ImportedPackages())
    if found := circle():
        sys.exit(f"these modules import each other: {', '.join(found)}; move what all need to one more")
    lint_imports_command()

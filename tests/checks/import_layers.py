"""Check which module may import which: `lint-imports` by the contracts in pyproject.toml, from the root.

import-linter takes a package below another one for a mistake, unless the outer one is a namespace.
`flowsculpt` is none, since it has names itself; and its packages lie beside it, where Python alone finds
them.
"""

from __future__ import annotations

from importlib.util import find_spec

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


if __name__ == "__main__":
    settings.configure(PACKAGE_FINDER=ImportedPackages())
    lint_imports_command()

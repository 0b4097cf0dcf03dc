"""The command `flowsculpt`: checks that the packages `pipeline` and `render` are this project's, and starts.

Other distributions have packages of the same names. Installers overwrite files silently, and the package
that comes first in the search path is the one that is imported. So this module, whose name is ours alone,
looks before anything of them runs. Modules are imported where Ctrl-C ends the command without a traceback.
"""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # its own module takes time to import
if TYPE_CHECKING:
    from pathlib import Path

PACKAGES = ("pipeline", "render")

EXIT_CODE, INTERRUPTED = 4, 130


def main() -> None:
    """Run the command line, or say that a package is another project's and exit with 4."""
    try:
        _start()
    except KeyboardInterrupt:  # until `_end` is set
        os._exit(INTERRUPTED)


def _start() -> None:
    import signal

    if signal.getsignal(signal.SIGINT) == signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    for name in PACKAGES:
        fault = foreign(name)
        if fault:
            print(f"error: {fault}", file=sys.stderr)
            sys.exit(EXIT_CODE)
    from render.base.python_process import postpone_collection

    postpone_collection()
    from pipeline.cli.app import main as start
    from pipeline.cli.standard_streams import prepare_streams

    prepare_streams()
    try:
        start()
    finally:
        if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
            signal.signal(signal.SIGINT, _end)


def _end(number: int, frame: object) -> None:
    """End at once on Ctrl-C: nothing has begun yet, or everything is done."""
    os._exit(INTERRUPTED)


def foreign(name: str) -> str | None:
    """Return what is wrong with a package if it is not this project's, else None."""
    from importlib.machinery import PathFinder
    from pathlib import Path

    home = Path(__file__).resolve().parent  # of this module and both packages
    found = PathFinder.find_spec(name)
    origin = Path(found.origin).resolve() if found is not None and found.origin else None
    if origin == home / name / "__init__.py" and not _overwritten(origin):
        return None
    return (
        f"{origin or name}: this is not flowsculpt's package {name}{_owners(name)}; Python imports only one "
        "package of a name. Install flowsculpt in an environment of its own: by pipx, or uv tool install."
    )


def _overwritten(file: Path) -> bool:
    """Tell whether an installed file differs from the record of the installation; editable ones have none."""
    import base64
    import hashlib
    from importlib.metadata import PackageNotFoundError, distribution

    try:
        record = distribution("flowsculpt").read_text("RECORD") or ""
    except PackageNotFoundError:
        return False
    for line in record.splitlines():
        path, _, rest = line.partition(",")
        if path == f"{file.parent.name}/{file.name}" and rest.startswith("sha256="):
            digest = base64.urlsafe_b64encode(hashlib.sha256(file.read_bytes()).digest()).rstrip(b"=")
            return rest.partition(",")[0] != f"sha256={digest.decode()}"
    return False


def _owners(name: str) -> str:
    from importlib.metadata import packages_distributions

    others = sorted(set(packages_distributions().get(name, ())) - {"flowsculpt"})
    return f", but that of {', '.join(others)}" if others else ""

"""The version of the contract with plug-ins, and what plug-ins of other versions are answered."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Any

API = 2
"""The version of the contract with plug-ins: names of `flowsculpt.api`, fields of `Plugin`, methods of parts.

It is raised when one of them goes away, or takes or returns something else; not when one is added. A plug-in
says in `api` which version it is built for. Built for a later one, or for one before OLDEST_API, it is left
out, as is a plug-in that uses a field that is gone.
"""

OLDEST_API = 1
"""The oldest version whose plug-ins work, as long as they use no field that has gone since."""

GONE = {
    "layouts": "subjects, which takes layouts of copies too",
    "documents": 'entries={"NAME": ShotEntry("module:Model")}',
    "stages": 'entries={"NAME": ShotEntry("module:Model", PictureStage(…))}',
    "exporters": 'commands={"export NAME": Command(…)}',
    **dict.fromkeys(
        ("watchers", "summaries", "delivered"),
        'observer="module:Class", with a class that extends RunObserver',
    ),
    **dict.fromkeys(
        ("sequences", "animations", "notes", "unneeded", "schemas"),
        'extras="module:Class", with a class that extends ShotExtras',
    ),
    "mesh_formats": 'formats={"SUFFIX": FileFormat(surface="module:READER")}',
    "paints": 'formats={"SUFFIX": FileFormat(paint="module:READER")}, with the surface of that suffix',
    "edits": 'formats={"SUFFIX": FileFormat(edit="module:function")}',
}
"""What plug-ins write in place of fields that went with version 2."""


def fault_of_version(api: Any) -> str | None:
    """Return why a plug-in built for a version of the API cannot be used; None where it can."""
    if not isinstance(api, int):
        return "its field api is not a whole number"
    if api > API:
        return f"it is built for version {api} of the API, and this flowsculpt has {API}; update flowsculpt"
    if api < OLDEST_API:
        return (
            f"it is built for version {api} of the API, and this flowsculpt takes {OLDEST_API} to {API}; "
            "install a newer version of the plug-in"
        )
    return None


def fault_of_fields(given: Iterable[str], known: Collection[str]) -> str | None:
    """Return why fields that a plug-in has been given are unknown; None where all are known."""
    for name in given:
        if name in GONE:
            return f"its field {name} is gone since version 2 of the API; write {GONE[name]}"
        if name not in known:
            return f"Plugin has no field {name}; correct it, or update flowsculpt if a later one has it"
    return None

"""Write the part of api.md that comes from the code: an entry for each name of `flowsculpt.__all__`.

Names are grouped by the package that defines them; Sphinx's autodoc reads their docstrings. Parameters may
be in columns, a name and two or more spaces before each text, or in the sections of numpy's style.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from itertools import takewhile
from typing import Any

from sphinx.ext.napoleon import Config, NumpyDocstring
from sphinx.util.inspect import stringify_signature

import flowsculpt
from flowsculpt.pipeline.flow.parameters import parameters_of

HEADINGS = {
    **dict.fromkeys(("mesh", "statistics", "plugins"), "Meshes"),
    "resample": "Resampling",
    "flow": "Flows",
}
"""Headings of packages of the pipeline, in the order of the page; the rest follows."""

ERRORS, OTHERS = "Errors", "Other names"

BULLET = "* ``{}``:"
"""How a row within the text of another one is written."""

_ROW = re.compile(r"(\w+(?:, \w+)*)( {2,})(\S.*)")
_UNDERLINE = re.compile(r"-{3,}")
_CODE = re.compile(r"(`+[^`]*`+)")


def entries() -> str:
    """Return MyST: a section for each group, with its table of contents and an entry for each name."""
    groups: dict[str, list[str]] = {heading: [] for heading in (*HEADINGS.values(), ERRORS, OTHERS)}
    left_out = []
    for name in flowsculpt.__all__:
        try:
            groups[_heading(getattr(flowsculpt, name))].append(name)
        except ImportError:  # of a plug-in that is not installed
            left_out.append(f"`{name}`")
    lines = [line for heading, names in groups.items() if names for line in _section(heading, names)]
    if left_out:
        lines += ["", f"Left out, because their plug-ins are not installed: {', '.join(left_out)}."]
    return "\n".join(lines)


def _heading(value: Any) -> str:
    if _kind(value) == "exception":
        return ERRORS
    package = re.match(r"flowsculpt\.pipeline\.(\w+)", str(getattr(value, "__module__", "")))
    return HEADINGS.get(package[1], OTHERS) if package else OTHERS


def _kind(value: Any) -> str:
    """Return autodoc's word for what a name is."""
    if inspect.isclass(value):
        return "exception" if issubclass(value, BaseException) else "class"
    return "function" if callable(value) else "data"


def _section(heading: str, names: list[str]) -> Iterator[str]:
    yield f"\n## {heading}\n"
    order = sorted(names, key=lambda name: (not inspect.isclass(getattr(flowsculpt, name)), name.lower()))
    yield from ("| | |", "|---|---|")
    for name in order:
        yield f"| [`{name}`](#flowsculpt.{name}) | {_summary(getattr(flowsculpt, name))} |"
    yield "\n```{eval-rst}"
    for name in order:
        yield f".. auto{_kind(getattr(flowsculpt, name))}:: flowsculpt.{name}\n"
    yield "```"


def _summary(value: Any) -> str:
    """Return the first sentence of a docstring, for a cell of a table."""
    first, _, _ = (inspect.getdoc(value) or "").partition("\n\n")
    return re.split(r"(?<=\.)\s", " ".join(first.split()), maxsplit=1)[0].replace("|", "\\|")


def write_signature(
    app: Any, what: str, name: str, value: Any, options: Any, arguments: str | None, returned: str | None
) -> tuple[str, str] | None:
    """Return a signature with types as in the source; autodoc would write out their aliases."""
    if arguments is None or what == "property":
        return None
    signature = inspect.signature(value)
    parameters = [_plain(parameter, value) for parameter in signature.parameters.values()]
    if what == "method" and parameters and parameters[0].name in ("self", "cls"):
        del parameters[0]
    result = "" if inspect.isclass(value) else _plain_type(signature.return_annotation, value)
    return stringify_signature(signature.replace(parameters=parameters), show_return_annotation=False), result


def _plain(parameter: inspect.Parameter, owner: Any) -> inspect.Parameter:
    """Return a parameter with a plain type and a default that is rounded or, of a factory, made."""
    default = parameter.default
    if isinstance(default, float):
        default = float(f"{default:.4g}")
    elif repr(default) == "<factory>":
        default = next(field for field in fields(owner) if field.name == parameter.name).default_factory()
    return parameter.replace(
        annotation=_plain_type(parameter.annotation, owner) or parameter.empty, default=default
    )


def _plain_type(annotation: Any, owner: Any) -> str:
    """Return a type without marks; a name that only looks like a public one is qualified."""
    if annotation is inspect.Signature.empty or not isinstance(annotation, str):
        return ""
    marked = re.fullmatch(r"Annotated\[([\w.]+(?:\[.*?\])?), .*\]", annotation)
    known = vars(sys.modules[owner.__module__])

    def qualified(name: re.Match[str]) -> str:
        meant = known.get(name[0])
        is_other = name[0] in flowsculpt.__all__ and meant not in (None, getattr(flowsculpt, name[0]))
        return f"{meant.__module__}.{name[0]}" if is_other else name[0]

    return re.sub(r"(?<![.\w])\w+", qualified, marked[1] if marked else annotation)


def is_inherited(app: Any, what: str, name: str, value: Any, skip: bool, options: Any) -> bool | None:
    """Return True, to skip it, for a member that a public base, or one derived from it, defines."""
    owner = getattr(flowsculpt, getattr(_function(value), "__qualname__", "").partition(".")[0], None)
    if not inspect.isclass(owner):
        return None
    known = tuple(_bases(owner))
    return True if any(name in vars(base) and issubclass(base, known) for base in owner.__mro__[1:]) else None


def _bases(value: type) -> list[type]:
    """Return the classes that a public class inherits from and that are public too."""
    return [base for base in value.__mro__[1:] if getattr(flowsculpt, base.__name__, None) is base]


def _function(member: Any) -> Any:
    """Return the function of a method or property."""
    functions = (getattr(member, name, None) for name in ("fget", "func", "__func__"))
    return inspect.unwrap(next(filter(None, functions), member))


def format_docstring(app: Any, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Turn a docstring's columns, or its sections of numpy's style, into fields, in place."""
    if any(_UNDERLINE.fullmatch(line) for line in lines):
        lines[:] = NumpyDocstring(lines, Config(), app, what, name, value, options).lines()
        return
    is_class = inspect.isclass(value)
    field = ":param {}:" if _describes_parameters(value, lines) else ":ivar {}:" if is_class else BULLET
    lines[:] = _converted(_markup("\n".join(lines)).split("\n"), lines, field)
    if is_class and what == "class":
        lines += ["", *_flow_parameters(value)]
        if bases := _bases(value):
            lines += ["", f"It also has the members of :py:class:`~flowsculpt.{bases[0].__name__}`."]
    if what == "property":
        function = _function(value)
        lines += ["", f":type: {_plain_type(function.__annotations__.get('return', ''), function)}"]


def _describes_parameters(value: Any, lines: list[str]) -> bool:
    """Return whether the rows of a docstring are parameters of the function or constructor."""
    parameters = inspect.signature(value).parameters if callable(value) else {}
    rows = [row[1].split(", ") for row in map(_ROW.fullmatch, lines) if row]
    return all(name in parameters for names in rows for name in names)


def _flow_parameters(value: type) -> Iterator[str]:
    """Yield the parameters of a flow, which its fields' annotations describe."""
    if _heading(value) == HEADINGS["flow"] and is_dataclass(value):
        for parameter in parameters_of(value):
            unit = parameter.doc.unit.replace("degrees", "radians")
            yield f":param {parameter.name}: {', '.join(filter(None, (parameter.doc.text, unit)))}"


def _converted(lines: list[str], raw: list[str], field: str) -> list[str]:
    """Return lines with rows as a list of fields, and indented blocks as written. `raw` has no markup."""
    written: list[str] = []
    place = 0
    while place < len(lines):
        row = _ROW.fullmatch(lines[place])
        if row and (field is BULLET or not any(written[-1:]) or written[-1].startswith((":", "    "))):
            if field is BULLET and any(written[-1:]) and not written[-1].startswith(("* ", "    ")):
                written.append("")
            column = len(row[1] + row[2])
            size = 1 + _indented(lines[place + 1 :], column)
            *others, last = row[1].split(", ")
            texts = [row[3], *(line[column:] for line in lines[place + 1 : place + size])]
            if not any(_ROW.fullmatch(text) for text in texts[1:]):
                texts = [text.strip() for text in texts]
            inner = _converted(texts, [line[column:] for line in raw[place : place + size]], BULLET)
            written += [field.format(other) for other in others]
            written += [f"{field.format(last)} {inner[0]}", *(f"    {line}".rstrip() for line in inner[1:])]
            if place + size < len(lines) and not _ROW.fullmatch(lines[place + size]):
                written.append("")
        elif lines[place].startswith("    "):
            size = _indented(lines[place:], 4)
            written += ["::", "", *raw[place : place + size], ""]
        else:
            size = 1
            written.append(lines[place])
        place += size
    return written


def _indented(lines: list[str], column: int) -> int:
    """Return how many lines, from the first one on, begin at a column or behind it."""
    return sum(1 for _ in takewhile(lambda line: line[:column].isspace(), lines))


def _markup(text: str) -> str:
    """Return text with code as literals or links to public classes, emphasis, and no other markup."""
    parts = _CODE.split(text)
    for place, part in enumerate(parts):
        code = part.strip("`")
        if not place % 2:
            parts[place] = re.sub(r"\\|\||(?<=\w)_(?!\w)|(?<!\S)\*(?=\s)", r"\\\g<0>", part)
        elif code[:1].isupper() and code in flowsculpt.__all__:
            parts[place] = f":py:obj:`~flowsculpt.{code}`"
        else:
            parts[place] = f"``{code}``"
    return "".join(parts)

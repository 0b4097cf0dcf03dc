"""Write plugin_names.md, the page of every name that plug-ins may import, from the docstrings of the code.

`make reference` runs it; a test holds the page to what the code says.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

PAGE = Path(__file__).with_suffix(".md")
FACADES = Path(__file__).parents[1] / "flowsculpt" / "api"

INTRODUCTION = """# Names for plug-ins

Every name that [plug-ins](plugins.md) may import, by the part of `flowsculpt.api` that has it, with the first
sentence of its docstring; `make reference` writes this page. They may import [the library](api.md) too."""

_LONGEST = 90  # characters of a signature with types; a longer one is written without


def page() -> str:
    """Return the page: a section for each facade, with a table of its names."""
    stubs = sorted(FACADES.glob("*.pyi"), key=lambda stub: (stub.stem != "__init__", stub.stem))
    lines = [INTRODUCTION]
    for stub in stubs:
        tree = ast.parse(stub.read_text(encoding="utf-8"))
        part = "flowsculpt.api" if stub.stem == "__init__" else f"flowsculpt.api.{stub.stem}"
        lines += [f"\n## `{part}`\n", ast.get_docstring(tree) or "", "", "| name | |", "|---|---|"]
        lines += _rows(tree)
    return "\n".join(lines) + "\n"


def _rows(tree: ast.Module) -> Iterator[str]:
    for module, name in sorted(_imports(tree), key=lambda place: place[1].lower()):
        value = getattr(import_module(module), name)
        signature = f"`{name}{_signature(value)}`".replace("|", "\\|")
        yield f"| {signature} | {_sentence(_docstring(module, name, value))} |"


def _imports(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Yield module and name of each import."""
    for node in tree.body:
        if isinstance(node, ast.ImportFrom) and node.module is not None:
            yield from ((node.module, alias.name) for alias in node.names)


def _signature(value: Any) -> str:
    """Return the parameters of a function as the source has them; nothing for anything else."""
    if not inspect.isroutine(value):
        return ""
    signature = inspect.signature(value)
    parameters = [each.replace(annotation=each.empty) for each in signature.parameters.values()]
    plain = str(signature.replace(parameters=parameters, return_annotation=signature.empty))
    typed = re.sub(r"(: |-> )'([^']*)'", r"\1\2", str(signature))  # annotations are text
    return re.sub(r"<function .*? at \w+>", "…", typed if len(typed) <= _LONGEST else plain)


def _docstring(module: str, name: str, value: Any) -> str:
    """Return the docstring of a class or a function, or the text below the definition of another value."""
    if inspect.isclass(value) or inspect.isroutine(value):
        return inspect.getdoc(value) or ""
    spec = find_spec(module)
    assert spec is not None and spec.origin is not None, module
    source = Path(spec.origin)
    stub = source.with_suffix(".pyi")
    tree = ast.parse((stub if stub.exists() else source).read_text(encoding="utf-8"))
    for node, following in zip(tree.body, [*tree.body[1:], None], strict=True):
        if isinstance(node, ast.ImportFrom) and node.module and name in [alias.name for alias in node.names]:
            return _docstring(node.module, name, value)
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        if name in [target.id for target in targets if isinstance(target, ast.Name)]:
            text = following.value if isinstance(following, ast.Expr) else None
            return str(text.value) if isinstance(text, ast.Constant) else ""
    return ""


def _sentence(docstring: str) -> str:
    """Return the first sentence of a docstring, for a cell of a table."""
    first, _, _ = docstring.partition("\n\n")
    return re.split(r"(?<=\.)\s", " ".join(first.split()), maxsplit=1)[0].replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")

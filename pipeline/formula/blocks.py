"""Three formulas compiled to one function that adds a velocity to each point of a block.

The function is compiled when formulas are first met, and filed with the kernels: a text that was seen before
is loaded. Numbers that a formula knows by name are handed over with each call and compile nothing.
"""

from __future__ import annotations

import hashlib
import math
import os
import sys
import tempfile
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np

from pipeline.formula.expression import Expression
from pipeline.formula.scalar_code import ScalarCode
from pipeline.formula.words import PLACE, TIME
from pipeline.kernels import BlockKernel, cache_folder

KNOWN = (*PLACE, *TIME)
"""What such formulas may always speak of."""

FRAME = "frame"
"""Its number is handed over: those that speak of it have it among their numbers."""

_MODULE = """\
def formula(numbers, count, xs, ys, zs, t, us, vs, ws):
    {once}
    for i in range(count):
        x, y, z = xs[i], ys[i], zs[i]
        {each}
        us[i] += {u}
        vs[i] += {v}
        ws[i] += {w}
"""


def compiled(
    formulas: tuple[Expression, Expression, Expression], numbers: tuple[str, ...] = ()
) -> BlockKernel:
    """The block function of three formulas over x, y, z, t, and `numbers`, in that order in its table."""
    return _loaded(source(formulas, numbers))


def source(formulas: tuple[Expression, Expression, Expression], numbers: tuple[str, ...] = ()) -> str:
    """What is compiled, as Python."""
    words = {name: f"number{k}" for k, name in enumerate(numbers)}
    code = ScalarCode({"x": "x", "y": "y", "z": "z", "t": "t", "time": "t", **words}, PLACE)
    u, v, w = (code.value(formula.tree) for formula in formulas)
    once = [f"{word} = numbers[{k}]" for k, word in enumerate(words.values())] + code.once
    return _MODULE.format(
        once="\n    ".join(once or ["pass"]),
        each="\n        ".join(code.each or ["pass"]),
        u=u,
        v=v,
        w=w,
    )


@cache
def _loaded(text: str) -> BlockKernel:
    """The function of a text, which stands in a file named after it: numba files its result under that."""
    folder = cache_folder() / "formulas"
    folder.mkdir(exist_ok=True)
    file = folder / f"formula_{hashlib.sha256(text.encode()).hexdigest()[:24]}.py"
    if not file.exists():
        _write(file, text)
    module = ModuleType(file.stem)
    vars(module).update(math=math, np=np)
    sys.modules[file.stem] = module  # where numba looks up what it has filed
    exec(
        compile(text, str(file), "exec", dont_inherit=True), vars(module)
    )  # our own words, written from a checked tree
    return BlockKernel(vars(module)["formula"])


def _write(file: Path, text: str) -> None:
    """Whole or not at all: several processes may meet a formula at once."""
    descriptor, draft = tempfile.mkstemp(dir=file.parent, suffix=".tmp")
    with os.fdopen(descriptor, "w") as stream:
        stream.write(text)
    Path(draft).replace(file)

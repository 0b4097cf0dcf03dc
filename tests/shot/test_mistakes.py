"""Shot files that are wrong: each mistake with its place, its rule and its remedy."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import MissingInputError, ShotError
from flowsculpt.pipeline.shot import read_shot

GOOD = (Path(__file__).parent / "cube.yaml").read_text(encoding="utf-8")


def written(folder: Path, text: str, name: str = "a.yaml") -> Path:
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


def told(folder: Path, text: str) -> list[str]:
    """The messages of a bad shot, without the folder."""
    with pytest.raises((ShotError, MissingInputError)) as error:
        read_shot(written(folder, text))
    return str(error.value).replace(f"{folder}/", "").split("\n")


BROKEN = [
    ("axis: z, cen", "axiz: z, cen",
     "a.yaml:8:18: flows.0.sum.0.vortex.axiz: unknown name. Did you mean 'axis'?"),
    ("strength", "strengths",
     "a.yaml:8:61: flows.0.sum.0.vortex.strengths: unknown name. Did you mean 'strength'?"),
    ("- vortex", "- vortx", "a.yaml:8:9: flows.0.sum.0.vortx: unknown name. Did you mean 'vortex'?"),
    ("solid: box", "solid: bax", "a.yaml:4:11: subject.solid: 'bax' is not a solid. Did you mean 'box'?"),
    ("linear", "lineal",
     "a.yaml:10:22: flows.1.twist.amount.ease: 'lineal' is not an easing. Did you mean 'linear'?"),
    ("radius: 0.8", "radius: wide",
     "a.yaml:8:48: flows.0.sum.0.vortex.radius: 'wide' is not a number"),
    ("radius: 0.8", "radius: -1",
     "a.yaml:8:48: flows.0.sum.0.vortex.radius: -1 is out of range; it must be above 0"),
    ("radius: 0.8", "radius: {keys: {1: 0.5, 9: 0}}",
     "a.yaml:8:72: flows.0.sum.0.vortex.radius.keys.9: 0 is out of range; it must be above 0"),
    ("[0.9, 0, 0]", "[0.9, 0]", "a.yaml:8:27: flows.0.sum.0.vortex.centre: [0.9, 0] has 2 numbers; "
     "it must have three, along x, y and z."),
    ("1: 0, 25: 4", "25: 4, 1: 0",
     "a.yaml:8:86: key 1 comes after key 25; keys go forward in time. Sort them."),
    ("25: 4", "25: {value: 4, ease: settle 2}",
     "a.yaml:8:100: flows.0.sum.0.vortex.strength.keys.25.ease: 'settle 2' is not an easing; the number "
     "after settle must be from 0.01 to 0.6. Write settle 0.15."),
    ("25: 4", "25: {value: 4, ease: sine_in 0.3}",
     "a.yaml:8:100: flows.0.sum.0.vortex.strength.keys.25.ease: 'sine_in 0.3' is not an easing. Did you mean "
     "'sine_in'?"),
    ("25: 4", "soon: 4",
     "a.yaml:8:85: key 'soon' is not a time; write a frame, such as 12, or seconds, such as 0.5s"),
    ("max_edge_length: 0.25", "max_edge_length: 0.05, min_edge_length: 0.03",
     "a.yaml:5:35: min_edge_length 0.03 is 60% of max_edge_length 0.05; it must be below 50%, "
     "or splitting and collapsing undo each other. Try 0.02."),
    ("1-49", "1-49x2", "a.yaml:2:1: frames 1-49x2 skip or turn back; a shot plays all. Write 1-49."),
    ("1-49", "all",
     "a.yaml:2:1: 'all' is not a frame range; write one as 1-48"),
    ("rate: 24", "rate: fast",
     "a.yaml:3:1: 'fast' is not a frame rate; write 24, 23.976 or 24000/1001"),
    ("title: Cube\n", "", "a.yaml:1:1: title: missing; it has no default"),
    ("title: Cube", "title: Cube\ntitle: Box",
     "a.yaml:2:1: title is given twice, first in line 1; one would be lost. Remove one of them."),
    ("solid: box", "solid: box, radius: 1",
     "a.yaml:4:23: radius is not a measure of a box. There are: size."),
    ("solid: box", "solid: box, size: [1, 2]",
     "a.yaml:4:23: size of a box has 3 numbers. Write [1, 2, 2]."),
    ("solid: box", "solid: box, size: wide",
     "a.yaml:4:23: subject.size: 'wide' is not a list"),
    ("solid: box", "solid: icosphere, radius: wide",
     "a.yaml:4:29: subject.radius: 'wide' is not a number"),
    ("solid: box", "model: bunny.obj",
     "a.yaml:4:11: model file bunny.obj is not there; it is looked for beside the shot file, as bunny.obj. "
     "Put it there or correct the name."),
    ("axis: z", "axis: [0, 0, 0]",
     "a.yaml:8:18: axis [0, 0, 0] has no direction. Write x, y, z or a vector."),
    ("axis: z", "axis: w", "a.yaml:8:18: flows.0.sum.0.vortex.axis: 'w' is not an axis. There are: x, y, z."),
    ("      - rotation: {speed: 90}", "      - {rotation: {speed: 90}, lorenz: }",
     "a.yaml:9:9: flows.0.sum.1: a flow is one name and its parameters, "
     "and this entry has lorenz and rotation. Start each flow with a dash of its own."),
    ("{max_edge_length: 0.25}", "no",
     "a.yaml:5:1: resample: 'no' is not allowed; it must be 'off' or a mapping, "
     "such as {max_edge_length: 0.05}. Did you mean 'off'?"),
    ("max_edge_length: 0.25", "max_edge_length: 0.25, placement: exct",
     "a.yaml:5:35: resample.placement: 'exct' is not a placement. Did you mean 'exact'?"),
    ("max_edge_length: 0.25", "max_edge_length: 0.25, rest_interval: 0",
     "a.yaml:5:35: resample.rest_interval: 0 is out of range; it must be at least 1"),
    ("max_edge_length: 0.25", "max_edge_length: 0.25, crease: rest",
     "a.yaml:5:35: resample.crease: unknown name. Did you mean 'creases'?"),
    ("camera:", "integrator: adaptiv\ncamera:",
     "a.yaml:11:1: integrator: 'adaptiv' is not an integrator. Did you mean 'adaptive'?"),
    ("camera:", "tolerance: 0.001\ncamera:",
     "a.yaml:11:1: tolerance is for the error that integrator: adaptive estimates, and rk4 estimates none. "
     "Write integrator: adaptive, or take it out."),
    ("camera:", "max_step: 0\ncamera:", "a.yaml:11:1: max_step: 0 is out of range; it must be above 0"),
    ("camera:", "substeps: 0\ncamera:", "a.yaml:11:1: substeps: 0 is out of range; it must be at least 1"),
    ("rate: 24", "rate: 1e-320",
     "a.yaml:3:1: frame rate 1e-320 is not from 0.1 to 1000, in frames per second; 24 is usual"),
    ("rate: 24", "rate: 1e999999999",
     "a.yaml:3:1: inf is not a frame rate; write 24, 23.976 or 24000/1001"),
    ("rate: 24", "rate: '1e999999999'",
     "a.yaml:3:1: '1e999999999' is not a frame rate; write 24, 23.976 or 24000/1001"),
    ("1-49", "1-100000000",
     "a.yaml:2:1: '1-100000000' reaches over more than 100000 frames; split it"),
    ('"2s"', f'"{"9" * 400}s"',
     f"a.yaml:10:49: key '{'9' * 49}…999s' is not a time; write a frame, such as 12, or seconds, "
     "such as 0.5s"),
    ("25: 4", f"{'9' * 290}: 4",
     f"a.yaml:8:85: key {'9' * 50}…99999 is not a time; write a frame, such as 12, or seconds, "
     "such as 0.5s"),
    ("25: 4", f"{'9' * 400}: 4",
     "a.yaml:8:85: key inf is not a time; write a frame, such as 12, or seconds, such as 0.5s"),
    ("25: 4", "25: 1e308",
     "a.yaml:8:85: flows.0.sum.0.vortex.strength.keys.25: 1e+308 is out of range; it must be at most 1e+12"),
    ("25: 4", f"25: -{'9' * 400}",
     "a.yaml:8:85: flows.0.sum.0.vortex.strength.keys.25: -inf is not a finite number"),
    ("[0.9, 0, 0]", "[0.9, 0, 2e12]",
     "a.yaml:8:44: flows.0.sum.0.vortex.centre.2: 2000000000000.0 is out of range; it must be at most 1e+12"),
    ("radius: 0.8", "radius: 1e-200",
     "a.yaml:8:48: flows.0.sum.0.vortex.radius: 1e-200 is too small to compute with; "
     "measures start at 1e-9. Write a larger one."),
    ("solid: box", "solid: icosphere, radius: 1e300",
     "a.yaml:4:29: subject.radius: 1e+300 is out of range; it must be at most 1e+12"),
    ("camera:", "substeps: 100000000\ncamera:",
     "a.yaml:11:1: substeps: 100000000 is out of range; it must be at most 10000"),
    ("camera:", "look: velvet\ncamera:",
     "a.yaml:11:1: look: 'velvet' is not a look. There are: clay, putty, glaze, ceramic, "
     "chrome, brushed, taffy, swirl, pearl, marble, cream, coffee, honey, glass, frosted, smoke, "
     "speed, strain, model, symbolics_1990."),
    ("camera:", "quality: {draught: {samples: 6}}\ncamera:",
     "a.yaml:11:11: quality.draught: unknown name. Did you mean 'draft'?"),
    ("camera:", "quality: {final: {samples: 100}}\ncamera:",
     "a.yaml:11:19: quality.final.samples: 100 samples do not divide into batches of 16. "
     "Write up to 16, or a multiple of it."),
    ("camera:", "quality: {draft: {noise_threshold: 0.02}}\ncamera:",
     "a.yaml:11:19: draft takes 4 samples, too few to stop earlier; noise_threshold needs "
     "9 or more. Write samples: 128 beside it."),
]  # fmt: skip


@pytest.mark.parametrize(("good", "bad", "message"), BROKEN, ids=[bad[:30] for _, bad, _ in BROKEN])
def test_a_mistake_is_told_with_its_place(tmp_path: Path, good: str, bad: str, message: str) -> None:
    assert good in GOOD
    assert told(tmp_path, GOOD.replace(good, bad)) == [message]


def test_all_mistakes_are_told_at_once_in_the_order_of_the_file(tmp_path: Path) -> None:
    text = (
        GOOD.replace("25: 4", "end: 4").replace("2s", "2 sec").replace("box", "bax").replace("speed", "sped")
    )
    places = [line.split(": ")[0] for line in told(tmp_path, text)]
    assert places == [
        "a.yaml:4:11",
        "a.yaml:8:85",
        "a.yaml:9:20",
        "a.yaml:10:49",
    ]


def test_only_a_missing_model_is_a_missing_input(tmp_path: Path) -> None:
    missing = GOOD.replace("solid: box", "model: bunny.obj")
    with pytest.raises(MissingInputError) as error:
        read_shot(written(tmp_path, missing))
    assert error.value.exit_code == 3
    with pytest.raises(ShotError) as wrong:
        read_shot(written(tmp_path, missing.replace("rate: 24", "rate: 0")))
    assert wrong.value.exit_code == 2 and len(wrong.value.messages) == 2


def test_a_torus_that_meets_itself_is_refused_with_its_place(tmp_path: Path) -> None:
    text = GOOD.replace("solid: box", "solid: torus, radius: 1, tube_radius: 2")
    assert told(tmp_path, text)[0].startswith("a.yaml:4:1: tube_radius 2 must be below radius 1")


STRAYS = [
    "",
    "null",
    "[]",
    "{}",
    "[1, 2, 3]",
    "{keys: {}}",
    "{keys: [1]}",
    "{? [1] : 2}",
    "-1",
    "true",
    ".nan",
    "9" * 400,
    "1e-320",
    "-1e308",
    "'x'",
]


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(line=st.integers(0, 10), stray=st.sampled_from(STRAYS), colon=st.integers(0, 5))
def test_no_stray_value_anywhere_raises_anything_else(
    tmp_path: Path, line: int, stray: str, colon: int
) -> None:
    lines = GOOD.splitlines()
    parts = lines[line].split(": ")
    kept = parts[: min(colon, len(parts) - 1) + 1]
    open_brackets = sum(": ".join(kept).count(mark) for mark in "{") - ": ".join(kept).count("}")
    lines[line] = ": ".join([*kept, stray]) + "}" * max(0, open_brackets)
    with contextlib.suppress(ShotError, MissingInputError):
        read_shot(written(tmp_path, "\n".join(lines)))


@pytest.mark.parametrize("text", ["[1, 2]", "just words", "null", "3", "title: {}", "? [a, b]\n: 1\n"])
def test_what_is_no_shot_at_all_is_told(tmp_path: Path, text: str) -> None:
    assert all(line.startswith("a.yaml:") for line in told(tmp_path, text))

"""`python -m benchmarks.flows`: each velocity field, against a kernel written for that field alone.

640,000 points are carried through one frame of four sub-steps, by one thread and by all. The kernel compared
with has the equation, its numbers and the Runge-Kutta step in one loop over the points. The last row is a
composition: a vortex, a strain at half strength within a ball, and a rotation. A uniform velocity is shown
without a target: its own kernel is one addition for all stages. Ratios are comparable between machines, times
are not. Writes `benchmarks/out/flows.json`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numba
import numpy as np
from numba import prange

from benchmarks.measures import told
from benchmarks.report import Row, Target, keep, show
from flowsculpt.pipeline.arrays import Points
from flowsculpt.pipeline.flow import Streamlines, Sum, VelocityField
from flowsculpt.pipeline.flow.catalogue import FLOWS
from flowsculpt.pipeline.flow.catalogue.basic import Expansion, Rotation, Strain
from flowsculpt.pipeline.flow.catalogue.vortices import Vortex
from flowsculpt.pipeline.flow.kernels import field_kernels as fields
from flowsculpt.pipeline.flow.kernels import instructions as op
from flowsculpt.pipeline.flow.kernels import streamline_kernels as kernels
from flowsculpt.pipeline.flow.kernels.region_kernels import ball_weight
from flowsculpt.pipeline.flow.parameters import shot_name
from flowsculpt.pipeline.flow.velocity import Instruction, Program, grouped, opcodes_of, table_of

POINTS, SUBSTEPS, STEP, REPEATS = 640_000, 4, 0.01, 5
FRAME, TOLERANCES = 1 / 24, (1e-5, 1e-9, 1e-11)
MOST = 1.3
"""Target: the time over that of the kernel written for the field."""

EQUATIONS = {
    code: getattr(fields, name.lower())
    for name, code in vars(fields).items()
    if isinstance(code, int) and hasattr(fields, name.lower())
}

IN_A_BALL = (0.0, 0.0, 0.0, 0.8, 0.0, 0.0, 0.5, 0.5, 0.0)


def fields() -> dict[str, Program]:
    """Return one field of every opcode, by name."""
    flows = [flow() for flow in FLOWS if issubclass(flow, VelocityField)]
    flows += [Vortex(profile="gaussian"), Vortex(profile="rankine")]
    flows += [Expansion("disc")]
    named = {f"{shot_name(type(flow))}": flow.program(0.2) for flow in flows[:-3]}
    named |= {
        name: flow.program(0.2)
        for name, flow in zip(("gaussian", "rankine", "disc"), flows[-3:], strict=True)
    }
    return {name: program for name, program in named.items() if len(program) == 1}


def composition() -> Program:
    inner = Vortex(radius=0.7, strength=3.0).program(0.0) + Strain(rate=0.8).program(0.0)
    return grouped(inner, Instruction(op.CLOSE_BALL, IN_A_BALL)) + Rotation().program(0.0)


def by_hand(program: Program) -> Any:
    """Return the equation of one field, or of the composition, for a tuple of its numbers."""
    if len(program) == 1:
        return numba.njit(EQUATIONS[program[0].opcode].py_func)
    swirl, stretch, turn, weigh = (
        numba.njit(one.py_func) for one in (fields.lamb_oseen, fields.strain, fields.rotation, ball_weight)
    )
    o_swirl, o_stretch, o_close, o_turn = (op.COLUMNS * row for row in (1, 2, 3, 4))

    def composed(p: Any, o: int, x: float, y: float, z: float) -> Any:
        a, b, c = swirl(p, o_swirl, x, y, z)
        d, e, f = stretch(p, o_stretch, x, y, z)
        factor = 0.5 * weigh(p, o_close, x, y, z)
        u, v, w = turn(p, o_turn, x, y, z)
        return u + factor * (a + d), v + factor * (b + e), w + factor * (c + f)

    return numba.njit(composed)


def fused(program: Program, parallel: bool) -> Callable[[Points, Points], None]:
    """Compile a kernel for this program alone; its numbers are arguments."""
    equation, numbers = by_hand(program), tuple(table_of(program).ravel().tolist())

    @numba.njit(parallel=parallel)  # type: ignore[untyped-decorator]  # numba has no types
    def follow(points: Points, p: Any, h: float, out: Points) -> None:
        for i in prange(len(points)):
            x, y, z = points[i, 0], points[i, 1], points[i, 2]
            for _ in range(SUBSTEPS):
                ax, ay, az = equation(p, 0, x, y, z)
                bx, by, bz = equation(p, 0, x + 0.5 * h * ax, y + 0.5 * h * ay, z + 0.5 * h * az)
                cx, cy, cz = equation(p, 0, x + 0.5 * h * bx, y + 0.5 * h * by, z + 0.5 * h * bz)
                dx, dy, dz = equation(p, 0, x + h * cx, y + h * cy, z + h * cz)
                x += h / 6.0 * (ax + 2.0 * (bx + cx) + dx)
                y += h / 6.0 * (ay + 2.0 * (by + cy) + dy)
                z += h / 6.0 * (az + 2.0 * (bz + cz) + dz)
            out[i, 0], out[i, 1], out[i, 2] = x, y, z

    return lambda points, out: follow(points, numbers, STEP, out)


def ours(program: Program, parallel: bool) -> Callable[[Points, Points], None]:
    """Return the kernel that runs any program."""
    kinds, tables = opcodes_of(program), np.tile(table_of(program).ravel(), 3)
    steps, spans = np.zeros((SUBSTEPS, 6), np.int64), np.full((SUBSTEPS, 3), np.inf)
    steps[:, 1], spans[:, 0] = len(kinds), STEP
    advect = kernels.advect_parallel if parallel else kernels.advect
    return lambda points, out: advect(points, kinds, tables, steps, spans, False, out)


def by_error(points: Points) -> list[Row]:
    """Measure a frame with fixed sub-steps and with those of a tolerance: milliseconds and the error.

    The flow is four vortices, each steep only in a small core; the reference has 32 times the sub-steps.
    """
    cores = [(x, y, 0.0) for x in (-0.6, 0.6) for y in (-0.6, 0.6)]
    field = Sum(tuple(Vortex(centre=core, radius=0.05, strength=0.5) for core in cores))
    exact = Streamlines(field, 32 * len(Streamlines(field).step_plan(0.0, FRAME).spans)).displace(
        points, 0.0, FRAME
    )
    rows: list[Row] = []
    for name, flow in {
        "rk4": Streamlines(field),
        **{f"adaptive, {tolerance:g}": Streamlines(field, tolerance=tolerance) for tolerance in TOLERANCES},
    }.items():
        flow.displace(points, 0.0, FRAME)
        moved, seconds = points, []
        for _ in range(REPEATS):
            start = time.perf_counter()
            moved = flow.displace(points, 0.0, FRAME)
            seconds.append(time.perf_counter() - start)
        rows.append(
            {"integrator": name, "ms": 1000 * min(seconds), "error": float(np.abs(moved - exact).max())}
        )
    return rows


def measure(name: str, program: Program, points: Points) -> Row:
    """Return the least milliseconds of both kernels, run in turn; check that their results agree."""
    row: Row = {"flow": name}
    for threads, parallel in (("1 thread", False), ("all", True)):
        works = {"ours": ours(program, parallel), "by hand": fused(program, parallel)}
        outs = {who: np.empty_like(points) for who in works}
        seconds: dict[str, list[float]] = {who: [] for who in works}
        for _ in range(REPEATS + 1):  # the first one compiles
            for who, work in works.items():
                seconds[who].append(_clocked(partial(work, points, outs[who])))
        np.testing.assert_allclose(outs["ours"], outs["by hand"], rtol=1e-9, atol=1e-9)
        best = {who: 1000 * min(times[1:]) for who, times in seconds.items()}
        row |= {f"ours, {threads}": best["ours"], f"by hand, {threads}": best["by hand"]}
        row[f"ratio, {threads}"] = best["ours"] / best["by hand"]
    return row


def _clocked(work: Callable[[], None]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def main() -> list[Target]:
    """Measure every field and the composition; return the targets."""
    points = 0.4 * np.random.default_rng(1).normal(size=(POINTS, 3))
    programs = {**fields(), "composition": composition()}
    rows = [measure(name, program, points) for name, program in programs.items()]
    show("Following a velocity field, milliseconds", rows)
    keep("flows", rows)
    adaptive = by_error(points[: POINTS // 10])
    show("Sub-steps by the gradient bound, and by their error", adaptive)
    keep("integrators", adaptive)
    rows = [row for row in rows if row["flow"] != "translation"]  # by hand it is one addition
    worst = {ratio: max(told(row, ratio) for row in rows) for ratio in ("ratio, 1 thread", "ratio, all")}
    return [Target("flows", f"{what}, at worst", found, most=MOST) for what, found in worst.items()]


if __name__ == "__main__":
    show("Targets", [target.row for target in main()])

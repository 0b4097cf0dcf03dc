"""The flow `become`: its path follows the data, arrives, returns, and refuses what it cannot reach."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterator
from pathlib import Path

import numba
import numpy as np
import pytest

from flowsculpt.pipeline.arrays import Floats, Points
from flowsculpt.pipeline.errors import FrameError, ShotError, UsageError
from flowsculpt.pipeline.mesh.solids import box, icosphere
from flowsculpt.pipeline.plugins.become import fit_kernels as kernels
from flowsculpt.pipeline.plugins.become import fitting, stored_fits, target
from flowsculpt.pipeline.plugins.become.become_flow import Become
from flowsculpt.pipeline.plugins.become.stored_fits import PlacedShape, fit_between
from flowsculpt.pipeline.plugins.become.target import FittedSurface, SolidGrowth, lengths
from flowsculpt.pipeline.plugins.become.velocity_path import PathSpace, energy
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.pipeline.production.tasks.render import flow_facts
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.pipeline.shot.subjects import Solid
from flowsculpt.render.post.image import read_header, write_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from tests.mesh_files import write_ply

RANDOM = np.random.default_rng(0)

SHOT = """\
title: Any
frames: 1-12
subject: {subject}
resample: {{max_edge_length: 0.3}}
flows: [{{{flows}}}]
"""


def shot(flows: str, subject: str = "{solid: icosphere}") -> Become:
    """The last flow of a shot, for which no file is written."""
    read = read_shot("a.yaml", SHOT.format(flows=flows, subject=subject))
    flow = read.motion.flow.flows[-1].flow  # type: ignore[attr-defined]
    assert isinstance(flow, Become)
    return flow


def told(flows: str, subject: str = "{solid: icosphere}") -> str:
    with pytest.raises(ShotError) as error:
        shot(flows, subject)
    return str(error.value)


def cubed(points: Points, faces: Floats) -> FittedSurface:
    """A surface about the origin with coordinates up to about 1, in the unit cube."""
    return FittedSurface(0.5 + 0.3 * points, faces.astype(np.int64))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Fits of a few small rounds, in a cache of their own."""

    def rounds_of(goal: FittedSurface, detail: str) -> list[fitting.FitRound]:
        space = PathSpace(12, 0.09)
        first = fitting.FitRound(PathSpace(12, 0.12), 1e-3, 800, 0.1, goal.growth.start, True)
        return [first, *(fitting.FitRound(space, 1e-6, 800, 0.06) for _ in range(2))]

    monkeypatch.setattr(fitting, "rounds_of", rounds_of)
    monkeypatch.setattr(target, "NODES", 40)
    monkeypatch.setattr(fitting, "START", PathSpace(12, 0.12))
    monkeypatch.setattr(stored_fits, "EDGES", 16)
    elsewhere = stored_fits.CachedAnswer.of

    def fits_here(kind: str, key: list[str], suffix: str = ".json") -> stored_fits.CachedAnswer:
        file = tmp_path / f"{hash(str(key))}{suffix}"
        return stored_fits.CachedAnswer(file) if kind == "fits" else elsewhere(kind, key, suffix)

    monkeypatch.setattr(stored_fits.CachedAnswer, "of", fits_here)
    fit_between.cache_clear()
    return tmp_path


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder for fits that several tests look at: one of them makes them."""
    return tmp_path_factory.mktemp("fits")


@pytest.fixture
def shared(quick: Path, fits: Path) -> Iterator[Path]:
    """The cache of `quick` with the fits of other tests, which it gives to them in turn."""
    shutil.copytree(fits, quick, dirs_exist_ok=True)
    yield quick
    shutil.copytree(quick, fits, dirs_exist_ok=True)


def test_the_derivatives_of_the_energy_are_those_of_differences() -> None:
    space = PathSpace(12, 0.1)
    z, points, goal = 0.02 * RANDOM.normal(size=space.size), *RANDOM.uniform(0.3, 0.7, (2, 40, 3))

    def data(x: Points) -> tuple[float, Floats]:
        return float(((x - goal) ** 2).sum()), 2.0 * (x - goal)

    _, slope = energy(space, z, points, data, 1e-3)
    for _ in range(3):
        way = RANDOM.normal(size=space.size)
        ahead, behind = (energy(space, z + sign * 1e-5 * way, points, data, 1e-3)[0] for sign in (1, -1))
        assert (ahead - behind) / 2e-5 == pytest.approx(float(np.sum(slope * way)), rel=1e-3)


def test_the_progress_of_a_fit_that_needs_no_box_ends_whole(quick: Path) -> None:
    ball, seen = icosphere(8), []
    surface = cubed(ball.vertices, ball.faces)
    fitting.fitted(surface, surface, "medium", None, lambda state, rounds: seen.append((state.done, rounds)))
    assert seen == [(n, 4) for n in range(1, 5)]


def test_a_path_keeps_its_velocities_on_a_finer_grid() -> None:
    coarse, fine = PathSpace(12, 0.1), PathSpace(20, 0.06)
    z = 0.02 * RANDOM.normal(size=coarse.size)
    ours, theirs = coarse.knots(z), fine.knots(coarse.converted(z, fine))
    assert theirs[:, :, ::5, ::5, ::5] == pytest.approx(ours[:, :, ::3, ::3, ::3], abs=1e-12)


def test_a_solid_grows_from_its_thickest_place_by_the_way_through_it() -> None:
    mesh = box((1.0, 1.0, 3.0), 0.2)
    growth = SolidGrowth.of(FittedSurface(0.5 + 0.2 * mesh.vertices, mesh.faces.astype(np.int64)))
    assert growth.start < growth.end == pytest.approx(0.2 * np.sqrt(0.25 + 0.25 + 2.25), rel=0.15)
    x = np.array([[0.5, 0.5, 0.5 + 0.2 * 1.2]])
    assert growth.part(growth.end).residual(x)[0][0] < 0.0 < growth.part(growth.start).residual(x)[0][0]


def test_a_surface_reaches_its_target_with_the_same_bits_on_one_and_on_two_threads(quick: Path) -> None:
    ball, goal = icosphere(8), box((1.4, 1.4, 1.4), 0.15)
    ends: list[Floats] = []
    for threads in (1, 2):
        numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
        rest, onto = cubed(ball.vertices, ball.faces), cubed(goal.vertices, goal.faces)
        state = fitting.fitted(rest, onto, "coarse", None, lambda state, rounds: None)
        ends.append(state.legs[-1].z)
    assert np.array_equal(*ends)
    x = state.legs[-1].carry(state.rest.points)
    away = lengths(x - onto.nearest(x)[0]) / onto.diagonal
    assert away.mean() < 0.01 < lengths(rest.points - onto.nearest(rest.points)[0]).mean() / onto.diagonal


def test_a_fit_that_was_interrupted_goes_on_and_ends_with_the_same_bits(shared: Path) -> None:
    ball, goal = (
        PlacedShape(Solid.of("icosphere", {}), (0, 0, 0)),
        PlacedShape(Solid.of("box", {"size": [1.5] * 3}), (0, 0, 0)),
    )
    whole = fit_between(ball, goal, "coarse")
    fit_between.cache_clear()
    (stored,) = shared.glob("*.npz")
    stored.unlink()
    with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
        rounds: list[int] = []
        step = fitting.next_round

        def third_fails(*given: object) -> fitting.State:
            rounds.append(1)
            if len(rounds) == 3:
                raise KeyboardInterrupt
            return step(*given)  # type: ignore[arg-type]

        patch.setattr(fitting, "next_round", third_fails)
        fit_between(ball, goal, "coarse")
    assert [file.name.endswith(".unfinished.npz") for file in shared.glob("*.npz")] == [True]
    assert np.array_equal(fit_between(ball, goal, "coarse").legs[0].z, whole.legs[0].z)
    fit_between.cache_clear()
    assert np.array_equal(fit_between(ball, goal, "coarse").legs[0].z, whole.legs[0].z), (
        "it is read from the cache"
    )


def test_a_fit_that_was_cut_short_or_holds_something_else_is_computed_again(
    shared: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class ComputedError(Exception):
        """Raised in place of computing."""

    def computed(*given: object) -> fitting.State:
        raise ComputedError

    ball = PlacedShape(Solid.of("icosphere", {}), (0, 0, 0))
    goal = PlacedShape(Solid.of("box", {"size": [1.5] * 3}), (0, 0, 0))
    fit_between(ball, goal, "coarse")
    monkeypatch.setattr(stored_fits, "fitted", computed)
    (file,) = shared.glob("*.npz")
    content, arrays = file.read_bytes(), dict(np.load(file))
    for damaged in (b"", content[:-10], content[:100], b"[]", *others_of(arrays)):
        for place in (file, file.with_suffix(".unfinished.npz")):
            place.write_bytes(damaged)
        fit_between.cache_clear()
        with pytest.raises(ComputedError):
            fit_between(ball, goal, "coarse")
    file.write_bytes(content)
    fit_between(ball, goal, "coarse")


def others_of(arrays: dict[str, Floats]) -> Iterator[bytes]:
    """Yield archives that lack an array of a fit, or have another in its place."""
    for name, other in (("z0", None), ("z0", arrays["z0"][1:]), ("n", np.array(8)), ("shares", np.zeros(3))):
        changed = {key: values for key, values in arrays.items() if key != name}
        file = io.BytesIO()
        np.savez(file, **changed, **({} if other is None else {name: other}))  # type: ignore[arg-type]
        yield file.getvalue()


def test_the_flow_arrives_in_any_steps_and_goes_back_exactly(shared: Path) -> None:
    flow = shot("become: {solid: box, size: [1.5, 1.5, 1.5], from: 3, to: 9, detail: coarse}")
    there_first = "become: {solid: box, size: [1.5, 1.5, 1.5], to: 6, detail: coarse}"
    back = shot(f"{there_first}}}, {{become: {{solid: icosphere, from: 6, detail: coarse}}")
    ball = icosphere(6).vertices
    assert np.array_equal(flow.displace(ball, 0.0, 2 / 24), ball)
    there = flow.displace(ball, 0.0, 0.5)
    half = flow.displace(flow.displace(ball, 0.0, 0.2), 0.2, 0.3)
    assert half == pytest.approx(there, abs=1e-5)
    assert np.abs(there).max(axis=1).mean() == pytest.approx(0.75, abs=0.03)
    assert back.displace(there, 0.0, 0.5) == pytest.approx(ball, abs=1e-5)
    with pytest.raises(FrameError, match="outside of the cube around the icosphere and the box"):
        flow.displace(9.0 * ball, 0.0, 0.5)


def test_a_spike_that_is_lost_grows_in_a_box_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    def rounds_in_box(growth: SolidGrowth) -> list[fitting.FitRound]:
        space = PathSpace(16, 0.07, True)
        until = np.linspace(0.0, growth.end, 4)[1:].tolist()
        return [fitting.FitRound(space, 1e-6, 600, 0.03, u, along=0.1) for u in (*until, None)]

    monkeypatch.setattr(fitting, "_rounds_in_box", rounds_in_box)
    monkeypatch.setattr(target, "NODES", 40)
    ball = icosphere(16)
    angle = np.arccos(np.clip(ball.vertices[:, 0], -1.0, 1.0))
    spiked = ball.vertices * (1.0 + 0.4 * np.clip(1.0 - (angle / 0.2) ** 2, 0.0, 1.0))[:, None]
    rest, onto = cubed(ball.vertices, ball.faces), cubed(spiked, ball.faces)
    state = fitting.State.at_rest(rest)
    assert fitting.lost_box(state, rest) is None
    box = fitting.lost_box(state, onto)
    assert box is not None
    low, side = box
    after = fitting.fitted_in_box(state, onto, low, side)
    residual, shares = stored_fits.residual_of(after.legs, after.rest, onto)
    assert residual.patch < 0.005 and residual.least > 0.02 and shares[1] > 0.12
    x, tip = after.legs[-1].carry(rest.points), onto.points[:, 0].max()
    outside = ((rest.points <= low) | (rest.points >= low + side)).any(axis=1)
    assert outside.any() and np.array_equal(x[outside], rest.points[outside])
    assert rest.points[:, 0].max() < tip - 0.1 and x[:, 0].max() == pytest.approx(tip, abs=0.01)


def test_keys_of_frames_do_not_wait_for_the_fit_and_hold_what_decides_it(quick: Path) -> None:
    flow, finer = (
        shot(f"become: {{solid: box, from: 3, to: 9, detail: {detail}}}") for detail in ("coarse", "fine")
    )
    assert flow.cache_data(0.0, 1 / 24) == finer.cache_data(0.0, 1 / 24) == {"become": None, "motion": 2}
    assert flow.cache_data(0.2, 1 / 24) != finer.cache_data(0.2, 1 / 24)
    assert not list(quick.iterdir())


def test_a_surface_that_becomes_another_is_renewed_at_rest_often_unless_its_shot_says_when() -> None:
    def interval(resample: str, flows: str = "become: {solid: box}") -> int:
        text = SHOT.format(flows=flows, subject="{solid: icosphere}").replace("0.3", resample)
        resampling = read_shot("a.yaml", text).motion.resampling
        assert resampling is not None
        return resampling.rest_interval

    assert interval("0.3") == 8
    assert interval("0.3, rest_interval: 30") == 30
    assert interval("0.3", "translation: {rate: [1, 0, 0]}") == 240


def test_a_residual_that_is_too_large_is_refused_and_told(
    shared: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flow = shot("become: {solid: box, size: [1.5, 1.5, 1.5], detail: coarse}")
    note, *_ = flow.findings()
    assert note[0].startswith("the icosphere becomes the box: it ends ") and not note[1]
    monkeypatch.setattr("flowsculpt.pipeline.plugins.become.become_flow.DOUBTFUL", 1e-6)
    assert any("is reached within" in text and warns for text, warns in flow.findings())
    monkeypatch.setattr("flowsculpt.pipeline.plugins.become.become_flow.REFUSED", 1e-6)
    with pytest.raises(
        UsageError,
        match=r"parts of the surface end over .*% of the diagonal away from the box; 0% is the most",
    ):
        flow.displace(icosphere(2).vertices, 0.0, 0.5)


def test_targets_that_a_flow_cannot_reach_are_refused(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError, match=r"the icosphere has no hole and the torus one hole; .* Begin with a torus"
    ):
        list(shot("become: {solid: torus}").findings())
    assert "a closed surface is needed: fill the holes" in told("become: {solid: sheet}")
    one, other = icosphere(2), icosphere(2, centre=(3.0, 0.0, 0.0))
    faces = np.concatenate([one.faces, other.faces + len(one.vertices)])
    write_ply(type(one)(np.concatenate([one.vertices, other.vertices]), faces), tmp_path / "two.ply")
    assert "it has 2 parts; become needs one" in told(f"become: {{model: {tmp_path / 'two.ply'}}}")


@pytest.mark.parametrize(
    ("entry", "fact"),
    [
        ("{solid: box, model: a.obj}", "what the subject becomes is one of model, solid"),
        ("{solid: boxx}", "boxx is not a solid. Write one of box"),
        ("{solid: box, fit: 2}", "fit is not a setting of the box"),
        ("{solid: box, size: [1, 2]}", "size of the box has 3 numbers"),
        ("{solid: box, from: 9, to: 3}", "become arrives before it begins"),
        ("{solid: box, from: soon}", "from: soon is not a time"),
        ("{solid: box, from: 2, progress: 0.5}", "become has progress as well as from or to"),
    ],
)
def test_entries_that_contradict_themselves_are_refused(entry: str, fact: str) -> None:
    assert fact in told(f"become: {entry}")


def test_one_that_begins_before_the_shot_is_warned_of() -> None:
    text = SHOT.format(flows="become: {solid: box, from: -9, to: 9}", subject="{solid: icosphere}")
    (note,) = read_shot("a.yaml", text).notes
    assert "become begins before frame 1, in which the subject is at rest, so it does not arrive" in note


def test_one_flow_begins_where_the_one_before_it_arrives() -> None:
    last = shot("become: {solid: box, to: 6}}, {become: {solid: rod, from: 6}")
    assert last.start is not None and last.start.name == "the box" and last.target.name == "the rod"
    assert shot("twist: {amount: 3}}, {become: {solid: rod}").others == ("twist",)


@pytest.mark.parametrize(
    "composition",
    [
        "within: {{region: {{sphere: {{radius: 1}}}}, flows: [{0}]}}",
        "repeated: {{period: 4, flows: [{0}]}}",
        "reversed: {{flows: [{{twist: {{amount: 3}}}}, {0}]}}",
        "blend: {{weight: 0.5, flows: [{{twist: {{amount: 3}}}}, {0}]}}",
        "sequence: {{flows: [{{placed: {{flows: [{0}]}}}}]}}",
    ],
)
def test_within_another_entry_it_is_refused_where_it_stands(composition: str) -> None:
    flows = composition.format("{become: {solid: rod}}")
    line = next(line for line in SHOT.format(flows=flows, subject="").splitlines() if "become" in line)
    message = told(flows)
    assert message.startswith(f"a.yaml:5:{line.index('{become') + 1}: become acts on a whole subject")
    assert message.endswith("Make it an entry of flows.")


def test_headers_of_frames_have_the_residual_and_the_review_page_shows_it(
    quick: Path, fits: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path_factory.mktemp("show"))
    flows = "become: {solid: box, size: [1.5, 1.5, 1.5], from: 3, to: 9, detail: coarse}"
    Path("shots").mkdir()
    Path("shots/a.yaml").write_text(SHOT.format(flows=flows, subject="{solid: icosphere}"))
    request = Project(Path(), 1).request(Show().find_shot("a"), "draft")
    assert flow_facts(request, 7) == {} and not list(quick.iterdir()), "a node that only renders fits nothing"
    shutil.copytree(fits, quick, dirs_exist_ok=True)
    fit = request.shot.motion.flow.flows[0].flow.fit()  # type: ignore[attr-defined]
    assert flow_facts(request, 3) == {}, "nothing has moved"
    write_exr(
        Path("a.exr"),
        RenderedFrame({"beauty": np.zeros((2, 2, 3), np.float32)}, {}),
        {"frame": 7} | flow_facts(request, 7),
    )
    from flowsculpt.pipeline.plugins.review.review_page import tabled

    shown = tabled([read_header(Path("a.exr"))])["same"]
    assert shown["flows.0.becomes"] == "the box" and shown["flows.0.detail"] == "coarse"
    assert 0.0 < fit.residual.mean == pytest.approx(shown["flows.0.residual.mean"], rel=1e-5)
    names = ("within_95", "worst_part", "least_volume")
    numbers = (fit.residual.most, fit.residual.patch, fit.residual.least)
    assert [shown[f"flows.0.residual.{name}"] for name in names] == pytest.approx(numbers, rel=1e-5)


def test_a_solid_with_a_hole_grows_from_a_loop_without_branches_into_its_limbs() -> None:
    nodes = np.stack(np.meshgrid(*[np.arange(48.0)] * 3, indexing="ij"), axis=-1)

    def inside(low: tuple[int, int, int], high: tuple[int, int, int]) -> Floats:
        return np.minimum(nodes - low, np.subtract(high, nodes)).min(axis=-1)

    ring = np.minimum(inside((4, 24, 18), (30, 46, 30)), -inside((11, 31, 0), (23, 39, 47)))
    limb = inside((12, 10, 19), (22, 30, 29)), inside((13, 6, 20), (21, 14, 28))  # thinner, then a foot
    depth = np.maximum.reduce([ring, *limb, inside((10, 1, 17), (24, 9, 31))])
    core = depth > 0.0
    kernels.thin(depth, core)
    assert np.argwhere(core)[:, 1].min() > 24

"""Wedges: every combination of values, all that is alike made once, and a sheet of it."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.plugins.sheets.wedge import Grid, Variation, Wedge
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.planning import planned_jobs
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.planning.profile import avoid
from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.post.image import read_exr, read_png
from tests.conftest import commanded, done

SMALL = ("-q", "draft", "--scale", "10%")

NAME = "T010_tiny"
QUALITY = "draft.scale10"
SHOT = """\
title: A box, twisted
frames: 1-12
subject: {solid: box, size: [2, 2, 2]}
resample: {max_edge_length: 1}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 9: 20, 12: 60}}}
quality: {draft: {samples: 1, auxiliary_samples: 1, denoise: off}}
"""
LATE, LOOK = "flows.0.twist.amount.keys.12=50,60,70", "look=clay,glaze"


@dataclass(frozen=True)
class Desk:
    root: Path

    def wedge(self, *vary: str, frames: str | None = None, at: int | None = None, cores: int = 4) -> Wedge:
        shot = self.root / "shots" / f"{NAME}.yaml"
        return Wedge(
            Project(self.root, cores),
            shot,
            Grid.parse(vary),
            QUALITY,
            frames and FrameRange.parse(frames),
            at,
        )

    def command(self, *words: str) -> tuple[int, str]:
        return commanded(self.root, *words)


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    root = tmp_path_factory.mktemp("wedge")
    (root / "shots").mkdir()
    (root / "shots" / f"{NAME}.yaml").write_text(SHOT)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        yield Desk(root)


def frames(plan: Plan) -> dict[str, int]:
    return dict(plan.frame_counts())


def spared(wedge: Wedge) -> dict[str, int]:
    return dict(wedge.plan().spared)


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("a.b=1:3:5", ("1", "1.5", "2", "2.5", "3")),
        ("a=-1:1:3", ("-1", "0", "1")),
        ("a=0:1:4", ("0", "0.333333", "0.666667", "1")),
        ("a=3:1:2", ("3", "1")),
        ("a = 0.05, 0.1", ("0.05", "0.1")),
        ("a=clay,glaze", ("clay", "glaze")),
        ("a=[1, 0, 0],[0, 1, 0]", ("[1, 0, 0]", "[0, 1, 0]")),
        ("a={material: clay, colour: [1, 0, 0]},'x, y'", ("{material: clay, colour: [1, 0, 0]}", "'x, y'")),
        ("a=1s:2s,3", ("1s:2s", "3")),
    ],
)
def test_values_are_steps_or_a_list(text: str, values: tuple[str, ...]) -> None:
    assert Variation.parse(text).values == values


@pytest.mark.parametrize(
    ("texts", "told"),
    [
        ((), "a wedge needs --vary"),
        (("strength",), "--vary strength: this varies nothing"),
        (("=1,2",), "this varies nothing"),
        (("a=",), "this varies nothing"),
        (("a=5",), r"--vary a=5: one value; a wedge needs at least two.*--set sets one"),
        (("a=1:3:1",), "one value; a wedge needs at least two"),
        (("a=1:3:0",), "no values"),
        (("a=1:3:99999999999999",), "are too many"),
        (("a=1e999:3:4",), "too large"),
        (("a=2:2:3",), "2 is listed twice"),
        (("a=x,y,x",), "x is listed twice"),
        (("a=1,2", "a=3,4"), "--vary a=3,4: a is varied twice"),
        (("a=1:2:11", "b=1:2:10"), "11 × 10 = 110 cells.*at most 100; .*--yes"),
    ],
)
def test_a_mistake_in_the_grid_is_told_at_its_argument(texts: tuple[str, ...], told: str) -> None:
    with pytest.raises(UsageError, match=told) as refused:
        Grid.parse(texts)
    assert "\n" not in str(refused.value)


def test_cells_are_told_apart_by_folders_and_captions() -> None:
    grid = Grid.parse(["flows.0.vortex.strength=1,2", "flows.1.vortex.strength=1,2", "look=[a/b],[a:b]"])
    cells = list(grid)
    assert len(grid) == len(cells) == len({cell.folder for cell in cells}) == 8
    said = [name for name, _ in cells[0].caption]
    assert said == ["flows.0.vortex.strength", "flows.1.vortex.strength", "look"]
    short = next(iter(Grid.parse(["flows.1.twist.amount.keys.31=0,80", "camera.target.1=0,1"]))).caption
    assert short == (("amount.keys.31", "0"), ("target.1", "0"))
    assert all("/" not in cell.folder and len(cell.folder) <= 100 for cell in cells)
    assert cells[1].settings == ("flows.0.vortex.strength=1", "flows.1.vortex.strength=1", "look=[a:b]")
    assert grid.columns == 2 and Grid.parse(["a=1,2,3"]).columns is None
    assert len(Grid.parse(["a=1:2:11", "b=1:2:10"], many=True)) == 110


def test_a_wedge_over_looks_simulates_once(desk: Desk) -> None:
    plan = desk.wedge(LOOK, frames="2-3").plan()
    assert frames(plan) == {
        "simulate": 12,
        "smooth_normals": 2,
        "frame_camera": 12,
        "render": 4,
        "finish": 4,
        "assemble": 4,
    }
    assert [job.threads for job in plan.jobs if job.stage == "simulate"] == [4]
    assert [job.threads for job in plan.jobs if job.stage == "render"] == [2, 2]


def test_what_a_display_shows_alone_renders_once(desk: Desk) -> None:
    wedge = desk.wedge("lights.exposure=-1,0,1", frames="1-2")
    assert frames(wedge.plan()) == {
        "simulate": 12,
        "smooth_normals": 2,
        "frame_camera": 12,
        "render": 2,
        "finish": 2,
        "assemble": 6,
    }
    assert spared(wedge) == {
        "simulate": 24,
        "smooth_normals": 4,
        "frame_camera": 24,
        "render": 4,
        "finish": 4,
    }


def test_a_late_key_shares_the_simulation_before_it(desk: Desk) -> None:
    plan = desk.wedge(LATE, LOOK).plan()
    simulations = [job for job in plan.jobs if job.stage == "simulate"]
    assert [(min(job.frames), max(job.frames)) for job in simulations] == [
        (1, 9),
        (10, 12),
        (10, 12),
        (10, 12),
    ]
    first, *others = simulations
    assert plan.all_inputs(first) == []
    assert all(plan.all_inputs(job) == [first.output] for job in others)


def test_short_beginnings_are_not_waited_for(desk: Desk) -> None:
    plan = desk.wedge("flows.0.twist.amount.keys.9=10,20,30").plan()
    simulations = [job for job in plan.jobs if job.stage == "simulate"]
    assert [len(job.frames) for job in simulations] == [12, 12, 12]
    assert all(not plan.all_inputs(job) for job in simulations)


@pytest.mark.parametrize(
    "vary", [(LATE, LOOK), ("flows.0.twist.amount=1:5:4",), ("lights.exposure=0,1", LOOK)]
)
def test_whatever_is_shared_every_job_finds_what_it_reads(desk: Desk, vary: tuple[str, ...]) -> None:
    """All inputs and targets are made by one job each, and nothing is waited for in a circle."""
    wedge = desk.wedge(*vary, frames="1-10x3")
    plan = wedge.plan()
    made = Counter(job.output for job in plan.jobs)
    assert set(made.values()) == {1}
    assert {output for job in plan.jobs for output in plan.all_inputs(job)} | set(plan.outputs) <= set(made)
    assert len({job.name for job in plan.jobs}) == len(plan.jobs)
    for job in plan.jobs:
        if job.stage == "finish":
            batches = [other for other in plan.jobs if other.output in plan.inputs(job, "render")]
            read = set(job.frames if job.reads is None else job.reads)
            assert read <= {number for batch in batches for number in batch.frames}
    waiting, missing = list(plan.jobs), set(made)
    while waiting:
        ready = [job for job in waiting if not missing & set(plan.all_inputs(job))]
        assert ready, "jobs wait for each other"
        missing -= {job.output for job in ready}
        waiting = [job for job in waiting if job not in ready]


@pytest.mark.slow
def test_a_wedge_is_rendered_and_drawn_and_leaves_the_shot_alone(desk: Desk) -> None:
    wedge = desk.wedge(LATE, "lights.exposure=0,1", frames="11-12")
    done(desk.root, wedge.plan())
    again = wedge.plan()
    assert again.jobs == () and spared(wedge) == {}
    store = wedge.project.store
    lost = Counter(
        link.kind for link in again.links if not store.shows(link.kind, link.key, Path(link.target))
    )
    assert lost["frame"] == 6, "those of cells whose light is that of others"
    assert again.restore_links(store) == lost.total() and lost["mesh"] and lost["normals"]
    assert not (desk.root / "renders" / NAME).exists()
    home = desk.root / "renders" / "wedge" / NAME
    assert {path.name for path in home.iterdir()} == {
        f"flows.0.twist.amount.keys.12={late},lights.exposure={stops}"
        for late in (50, 60, 70)
        for stops in (0, 1)
    }
    places = [home / cell.folder / QUALITY / "frames" / f"{NAME}.0012.exr" for cell, _ in wedge.requests]
    pictures = [read_exr(place)[0]["beauty"].tobytes() for place in places]
    assert pictures[::2] == pictures[1::2] and len(set(pictures)) == 3
    still, movie = (desk.root / path for path in wedge.draw())
    page = read_png(still)
    assert still.name == f"flows.0.twist.amount.keys.12,lights.exposure.{QUALITY}.0012.png"
    facts, sides = probe_movie(movie), (page.shape[1], page.shape[0])
    assert facts.frames == 2 and (facts.width, facts.height) == tuple(side + side % 2 for side in sides)
    keys = wedge.requests[2][1].keys.pictures(wedge.project.store)
    assert keys is not None
    wedge.project.store.discard("frame", keys[12].frame)
    wedge.draw()
    lost = read_png(still)
    assert lost.shape == page.shape and (lost != page).any(), "a sheet is drawn of what is there"


def test_a_simulation_that_was_shared_has_the_bits_of_one_that_was_not(desk: Desk, tmp_path: Path) -> None:
    (tmp_path / "shots").mkdir()
    (tmp_path / "shots" / f"{NAME}.yaml").write_text(SHOT)
    folders = []
    for many in (planned_jobs.MIN_SHARED, 1000):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(planned_jobs, "MIN_SHARED", many)
            root = tmp_path / str(many)
            root.mkdir()
            wedge = Wedge(
                Project(root, 2),
                tmp_path / "shots" / f"{NAME}.yaml",
                Grid.parse([LATE]),
                QUALITY,
                frames=FrameRange.parse("12"),
            )
            plan = wedge.plan()
            simulations = [job for job in plan.jobs if job.stage == "simulate"]
            done(root, Plan(plan.requests, None, tuple(simulations)))
            folders.append({path.name: path.read_bytes() for path in root.rglob("store/mesh/*/*.npz")})
    assert len(folders[0]) == 9 + 3 * 3 and folders[0] == folders[1]


def test_after_a_crash_all_cells_are_rendered_by_the_next_variant(desk: Desk, tmp_path: Path) -> None:
    wedge = Wedge(Project(tmp_path, 2), desk.root / "shots" / f"{NAME}.yaml", Grid.parse([LOOK]), QUALITY)
    (before,) = {request.variant for request in wedge.plan().requests}
    if not avoid(tmp_path, NAME, before, f"{before} crashed"):
        pytest.skip("there is only one variant here to choose from")
    (after,) = {request.variant for request in wedge.plan().requests}
    assert after != before


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (
            ["--vary", "flows.0.twst.amount=1,2"],
            "--vary flows.0.twst.amount=1,2: at 1, flows.0 has no twst. Did",
        ),
        (["--vary", "look=clay,cley"], "--vary look=clay,cley: at cley, "),
        (["--vary", "resample.max_edge_length=1,-1"], "--vary resample.max_edge_length=1,-1: at -1, "),
        (["--vary", "lok=clay,glaze"], "--vary lok=clay,glaze: at clay, "),
        (
            [LOOK.join(("--vary=", "")), "--at", "99"],
            "--at 99: this frame is not rendered; choose one of 1-12",
        ),
        (
            [f"--vary={LOOK}", "-f", "3-4", "--at", "5"],
            "--at 5: this frame is not rendered; choose one of 3-4",
        ),
        ([f"--vary={LOOK}", "-f", "30"], "T010_tiny.yaml: frame 30 is not in the shot"),
        ([f"--vary={LOOK}", "-f", "failed"], "'failed' is not a frame range"),
        (["--vary", "look=cl\nay,glaze"], r"--vary look=cl\nay,glaze: at cl\nay, "),
        ([f"--vary={LOOK}", "-q", "fnal"], "'fnal' is not a quality"),
        ([f"--vary={LOOK}", "--set", "lok=clay"], "lok"),
    ],
)
def test_a_mistake_is_one_message_at_its_argument(desk: Desk, words: list[str], told: str) -> None:
    code, said = desk.command("--dry-run", "wedge", NAME, *words)
    assert code == 2 and told in said and said.strip().count("\n") == 0, said
    assert said.startswith("--vary") or not told.startswith("--vary")


def test_amounts_without_keys_are_told_once_with_the_variation_that_moves(desk: Desk) -> None:
    words = ("--dry-run", "wedge", NAME, "--vary", LOOK, "--vary")
    code, said = desk.command(*words, "flows.0.twist.amount=20,80")
    advised = "--vary flows.0.twist.amount.keys.12=20,80"
    assert code == 0 and said.count("twist moves nothing") == 1
    assert f"Vary one of its keys instead: {advised}." in said
    assert "moves nothing" not in desk.command(*words, advised.partition(" ")[2])[1]
    constant = ("--set", "flows.0.twist.amount=5")
    _, said = desk.command(*words, "flows.0.twist.amount=20,80", *constant)
    assert f"Write amount: {{keys: {{1: 0, 12: 20}}}} in the shot file, and vary it: {advised}." in said


def test_a_dry_run_tells_the_grid_and_what_is_shared(desk: Desk) -> None:
    words = ("--dry-run", "wedge", NAME, "--vary", "stage=none,plinth", "--vary", LATE, "--set", "rate=25")
    code, said = desk.command(*words)
    assert code == 0
    assert "stage=none  flows.0.twist.amount.keys.12=50\n" in said
    assert "6 cells of 1 frame, the sheet at 7." in said and "Shared, and done once: " in said
    facts = json.loads(desk.command("--json", *words)[1])
    assert len(facts["cells"]) == 6 and facts["shared"]["simulate"] > 0 and "estimate" in facts
    assert facts["cells"][0]["folder"].startswith(f"renders/wedge/{NAME}/stage=none,")


@pytest.mark.soak
def test_a_wedge_is_one_run_and_the_second_does_nothing(project: Any) -> None:
    vary = (
        "--vary",
        "flows.0.twist.amount.keys.6=40,80",
        "--vary",
        "look=clay,glaze",
        "--vary",
        "lights.exposure=0,1",
    )
    first = project.run("--json", "wedge", NAME, *vary, "-f", "5-6", *SMALL)
    assert first.code == 0, first.err
    facts = json.loads(first.out)
    assert len(facts["cells"]) == 8 and facts["made"]["render"] == 8
    still, movie = (project.path / sheet for sheet in facts["sheets"])
    assert still.is_file() and probe_movie(movie).frames == 2
    frames = [project.path / cell["folder"] / "draft.scale10" / "frames" for cell in facts["cells"]]
    assert all(len(list(folder.glob("*.exr"))) == 2 for folder in frames)
    again = json.loads(project.run("--json", "wedge", NAME, *vary, "-f", "5-6", *SMALL).out)
    assert again["made"] == {} and again["done"]

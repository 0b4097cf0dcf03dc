"""Writing review pages, sheets and figures: what is there, what is not, and what is made again."""

from __future__ import annotations

import base64
import json
import os
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.mesh import TriangleMesh, box, icosphere
from flowsculpt.pipeline.plugins.review.figures import panels
from flowsculpt.pipeline.plugins.review.measures import BINS, edge_lengths, measured, roundness_of, volume_of
from flowsculpt.pipeline.plugins.review.review_page import tabled
from flowsculpt.pipeline.plugins.review.view_3d import as_script
from flowsculpt.render.post.image import read_png
from tests.needed_plugins import needs_plugins
from tests.plugins.review.note_cases import IDS, document, note
from tests.plugins.review.studio import FAILED, FAULT, MISSING, number_in
from tests.simulated_show import LAST, NAME, TITLE, Desk

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _at_the_desk(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    """Shots are looked for in the working folder."""
    monkeypatch.chdir(desk.root)


@pytest.fixture
def copy(desk: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Desk:
    """The studio, to be changed; its files are links until they are replaced."""
    root = tmp_path / "studio"
    shutil.copytree(desk.root, root, copy_function=os.link)
    monkeypatch.chdir(root)
    return Desk(root)


def data_of(desk: Desk, name: str = NAME) -> dict[str, Any]:
    text = (desk.page(name).parent / "data.js").read_text()
    return dict(json.loads(text.removeprefix("window.reviewData = ").rstrip(";\n")))


def files_in(folder: Path) -> dict[str, tuple[int, int]]:
    """Their names, and what would tell that one was written again."""
    facts = {path.relative_to(folder).as_posix(): path.stat() for path in folder.rglob("*") if path.is_file()}
    return {name: (stat.st_ino, stat.st_mtime_ns) for name, stat in facts.items() if name != "data.js"}


@needs_plugins("sheets")
def test_a_page_has_what_was_rendered_and_the_cells_of_wedges(desk: Desk) -> None:
    data = data_of(desk)
    labels = [each["label"] for each in data["sequences"]]
    assert labels == ["daily.scale50", "draft", "look chrome · draft", "look glaze · draft"]
    draft = data["sequences"][1]
    assert draft["states"] == {
        str(FAILED): ["failed", FAULT],
        str(MISSING): ["missing", "it is not rendered"],
    }
    assert [bool(name) for name in draft["files"]] == [n not in (FAILED, MISSING) for n in range(1, LAST + 1)]
    assert data["sequences"][2]["numbers"] == [1, 2, 3, 4]
    assert data["wedges"][0]["cells"] == [2, 3]
    shown = desk.page().parent / "pictures" / draft["files"][11]
    assert number_in(read_png(shown)) == 12
    panels = {panel["title"]: panel for panel in data["shots"][NAME]["panels"]}
    assert panels["volume"]["curves"][0][0] == pytest.approx(8.0)
    assert len(panels["edge lengths"]["heat"]) == LAST
    assert sum(panels["edge lengths"]["heat"][8]) == pytest.approx(1.0, abs=1e-3)


def test_a_second_time_nothing_is_made_and_the_same_is_written(copy: Desk) -> None:
    folder = copy.page().parent
    copy.command("review", NAME)  # a page knows the folder that it was written to
    before, data = files_in(folder), (folder / "data.js").read_bytes()
    code, _ = copy.command("review", NAME)
    assert (code, files_in(folder), (folder / "data.js").read_bytes()) == (0, before, data)


def test_notes_of_several_reviewers_are_on_the_page_from_the_start(copy: Desk) -> None:
    for name, words in (("ann", "softer"), ("ben", "</script><script>window.attacked = 1</script>")):
        given = note(id=IDS[name == "ben"], shot=NAME, author=name, text=words)
        (copy.root / f"{name}.json").write_text(json.dumps(document(given)))
    code, said = copy.command("review", NAME, "--notes", "ann.json", "--notes", "ben.json")
    assert code == 0 and "4 sequences, 54 pictures, 2 notes." in said
    assert [each["author"] for each in data_of(copy)["notes"]] == ["ann", "ben"]
    assert "</script>" not in (copy.page().parent / "data.js").read_text()
    assert (copy.root / "notes" / f"{NAME}.json").is_file()
    before = copy.page().parent.joinpath("data.js").read_bytes()
    assert copy.command("review", NAME, "--notes", "gone.json")[0] == 3
    assert copy.page().parent.joinpath("data.js").read_bytes() == before


def test_pictures_that_are_no_more_shown_leave_the_page(copy: Desk) -> None:
    frame = copy.root / "renders" / NAME / "daily.scale50" / "frames" / f"{NAME}.0003.exr"
    old = data_of(copy)["sequences"][0]
    frame.unlink()
    code, words = copy.command("review", NAME, "--json")
    assert code == 0 and json.loads(words)["not_as_asked_for"][f"{NAME} daily.scale50"] == [3]
    new, folder = data_of(copy)["sequences"][0], copy.page().parent / "pictures"
    assert new["files"][2] is None and not (folder / old["files"][2]).exists()
    assert new["files"][3] == old["files"][3] and (folder / old["files"][3]).exists()


def test_after_an_edit_pictures_are_stale_and_the_meshes_that_they_show_are_measured(copy: Desk) -> None:
    shot = copy.root / "shots" / f"{NAME}.yaml"
    text = shot.read_text()
    shot.unlink()  # it is a link
    shot.write_text(text.replace("16: 36", "16: 30"))
    before = data_of(copy)["shots"][NAME]
    code, _ = copy.command("review", NAME)
    after = data_of(copy)
    assert code == 0 and after["shots"][NAME]["panels"] == before["panels"]
    assert after["shots"][NAME]["models"] == before["models"]
    daily = after["sequences"][0]
    assert all(daily["files"]) and daily["states"]["24"][0] == "stale"


def test_a_picture_that_is_cut_short_becomes_a_slate_and_the_rest_a_page(copy: Desk) -> None:
    frame = copy.root / "renders" / NAME / "daily.scale50" / "frames" / f"{NAME}.0005.exr"
    whole = frame.read_bytes()
    frame.unlink()
    frame.write_bytes(whole[:200])
    code, _ = copy.command("review", NAME)
    assert code == 0
    state, why = data_of(copy)["sequences"][0]["states"]["5"]
    assert state == "failed" and "flowsculpt verify repairs it" in why


@pytest.mark.slow
def test_a_quality_alone_can_be_shown_and_a_page_be_named(copy: Desk) -> None:
    code, words = copy.command("review", NAME, "-q", "daily.scale50", "--name", "monday", "--as", "png")
    assert code == 0 and words.startswith(str(copy.page("monday")))
    sequences = data_of(copy, "monday")["sequences"]
    assert [each["label"] for each in sequences] == ["daily.scale50"]
    assert all(name.endswith(".png") for name in sequences[0]["files"])


def test_data_of_a_page_contain_no_tag_and_the_page_runs_its_own_scripts_alone(desk: Desk) -> None:
    folder = desk.page().parent
    assert TITLE in data_of(desk)["shots"][NAME]["title"]
    assert all("<" not in script.read_text() for script in (folder / "data.js", *folder.glob("models/*.js")))
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', (folder / "index.html").read_text())
    assert policy and policy[1].startswith("default-src 'none'; script-src 'self'")
    assert "unsafe" not in policy[1] and "http" not in policy[1]
    assert not re.search(r"<script>|\bon\w+=|javascript:", (folder / "index.html").read_text())


def test_the_page_needs_nothing_beside_its_folder(desk: Desk) -> None:
    folder = desk.page().parent
    for source in (folder / "index.html", *folder.glob("page/*")):
        assert not re.search(r"https?://(?!www\.w3\.org/)", source.read_text()), source
    named = re.findall(r'(?:src|href)="([^"]+)"', (folder / "index.html").read_text())
    assert all((folder / name).exists() for name in named if not name.startswith("data:"))


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (["review", "T010_tinny"], 3, "T010_tiny"),
        (["review", NAME, "-q", "splendid"], 2, "'splendid' is not a quality"),
        (["review", NAME, "-q", "final"], 3, f"flowsculpt render {NAME} -q final makes them"),
        (["review", NAME, "--as", "gif"], 2, "--as gif"),
        (["review", NAME, "--name", "../away"], 2, "--name ../away"),
        (["review", NAME, "--notes", "ann.json", "ben.json"], 2, "ben.json: --notes takes one file"),
        (["figures", "T010_tinny"], 3, "T010_tiny"),
        (["figures", NAME, "-o", "figures.txt"], 2, "figures.txt"),
        pytest.param(
            *(["sheet", NAME, "-o", "sheet.jpg"], 2, "sheet.jpg is not a PNG"), marks=needs_plugins("sheets")
        ),
        pytest.param(
            *(["sheet", NAME, "--at", "3"], 2, "--at is the frame of --looks"), marks=needs_plugins("sheets")
        ),
        pytest.param(
            *(["sheet", NAME, "-f", "1-99"], 2, "25-99 are not in the shot"), marks=needs_plugins("sheets")
        ),
    ],
)
def test_what_cannot_be_is_told_in_one_line(desk: Desk, words: list[str], code: int, told: str) -> None:
    ended, said = desk.command(*words)
    assert ended == code and told in said and len(said.strip().splitlines()) == 1


def test_a_shot_that_is_not_rendered_says_what_renders_it(copy: Desk) -> None:
    text = (copy.root / "shots" / f"{NAME}.yaml").read_text()
    (copy.root / "shots" / "T020_new.yaml").write_text(text.replace("[2, 2, 2]", "[3, 2, 2]"))
    code, said = copy.command("review", "T020_new")
    assert code == 3 and "flowsculpt render T020_new -q draft makes them" in said
    code, said = copy.command("figures", "T020_new")
    assert code == 3 and "flowsculpt simulate T020_new makes them" in said


def test_a_folder_that_cannot_be_written_is_told(copy: Desk) -> None:
    shutil.rmtree(copy.root / "renders" / "review")
    (copy.root / "renders" / "review").write_text("in the way")
    code, said = copy.command("review", NAME)
    assert code == 4 and "a file stands where a folder should be" in said


@pytest.mark.slow
def test_figures_are_drawn_and_the_same_every_time(copy: Desk) -> None:
    page = copy.root / "renders" / NAME / f"{NAME}.figures.svg"
    drawn = []
    for _ in range(2):
        code, words = copy.command("figures", NAME, "--json")
        assert code == 0 and json.loads(words)["frames"] == list(range(1, LAST + 1))
        drawn.append(page.read_bytes())
    assert drawn[0] == drawn[1]
    assert {"vertices", "edge lengths", "volume"} <= set(json.loads(words)["figures"])


def test_crossings_are_those_of_every_eighth_frame_and_the_last_or_on_request_of_all(copy: Desk) -> None:
    request, store = copy.request("draft"), copy.project().store
    numbers = range(1, LAST + 1)
    for asked, expected in ((False, [1, 9, 17, 24]), (True, list(numbers))):
        rows = measured(request, store, numbers, 1, count_crossings=asked)
        assert [n for n, row in rows.items() if row["crossings"] is not None] == expected


def test_a_figure_of_crossings_says_in_which_frames_they_are_counted() -> None:
    numbers = list(range(1, 10))
    rows = {n: {"crossings": {1: 0, 9: 4}.get(n)} for n in numbers}
    (panel,) = panels(numbers, rows, (None, None), {})
    assert panel.unit == "pairs of faces, counted in the frames with a dot"
    assert panel.frames.tolist() == [1.0, 9.0] and panel.values.ravel().tolist() == [0.0, 4.0]
    assert panels(numbers, {n: {"crossings": 0} for n in numbers}, (None, None), {}) == []


@needs_plugins("sheets")
def test_a_sheet_shows_frames_of_a_shot_in_rows(copy: Desk) -> None:
    code, words = copy.command(
        "sheet", NAME, "-q", "daily.scale50", "-f", "1-24x5", "--columns", "3", "--json"
    )
    told = json.loads(words)
    assert code == 0 and told["frames"] == [1, 6, 11, 16, 21] and told["rendered"] == 0
    sheet = read_png(Path(told["path"]))
    lit = np.flatnonzero((sheet[..., 0] > 250).mean(axis=1) > 0.5)
    assert sheet.shape[1] < 2 * sheet.shape[0] * 1.4 and len(lit) > 100


@settings(max_examples=25, deadline=None)
@given(st.integers(2, 6), st.floats(0.1, 10.0), st.tuples(*[st.floats(-5.0, 5.0)] * 3))
def test_measures_go_with_size_and_not_with_place(rings: int, size: float, place: tuple[float, ...]) -> None:
    ball = icosphere(rings)
    moved = TriangleMesh(ball.vertices * size + np.array(place), ball.faces)
    plain, volume = volume_of(ball), volume_of(moved)
    assert plain is not None and volume == pytest.approx(plain * size**3, rel=1e-6)
    assert np.allclose(edge_lengths(moved), edge_lengths(ball) * size, rtol=1e-6)
    assert np.allclose(roundness_of(moved), roundness_of(ball), atol=1e-6)


def test_a_surface_with_a_rim_has_no_volume_and_an_equilateral_triangle_is_round() -> None:
    cube = box((2.0, 2.0, 2.0))
    assert volume_of(cube) == pytest.approx(8.0)
    assert volume_of(TriangleMesh(cube.vertices, cube.faces[1:])) is None
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 3**0.5 / 2, 0.0]])
    assert roundness_of(TriangleMesh(corners, np.array([[0, 1, 2]], np.int32))) == pytest.approx(1.0)
    assert BINS >= 20


def test_meshes_on_a_page_are_where_they_were_to_a_65536th() -> None:
    ball = icosphere(6)
    normals = ball.vertices / np.linalg.norm(ball.vertices, axis=1, keepdims=True)
    text = as_script("m.js", {"vertices": ball.vertices * [1, 2, 3], "normals": normals, "faces": ball.faces})
    data = json.loads(text.removeprefix('reviewModel("m.js", ').removesuffix(");\n"))
    steps = np.frombuffer(base64.b64decode(data["positions"]), "<u2").reshape(-1, 3)
    back = data["low"] + steps * data["step"]
    assert np.abs(back - ball.vertices * [1, 2, 3]).max() <= 0.51 * 6 / 65535
    assert (np.frombuffer(base64.b64decode(data["faces"]), "<u2").reshape(-1, 3) == ball.faces).all()


HEADERS = st.lists(
    st.dictionaries(st.sampled_from("abcd"), st.integers(0, 2) | st.lists(st.integers(0, 3), max_size=3)),
    min_size=1,
    max_size=5,
)


@given(HEADERS)
def test_every_header_can_be_read_back_from_its_table(headers: list[dict[str, Any]]) -> None:
    table = tabled(headers)
    for place, header in enumerate(headers):
        differing = {name: values[place] for name, values in table["differ"].items()}
        found = {**table["same"], **differing}
        assert {name: value for name, value in found.items() if value is not None} == header

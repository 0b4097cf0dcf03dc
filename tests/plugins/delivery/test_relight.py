"""Relighting: finished frames with other factors on their lights, without rendering."""

from __future__ import annotations

import json
from pathlib import Path

import av
import numpy as np
import pytest

from flowsculpt.pipeline.plugins.delivery.relighting import permanent
from flowsculpt.render.movie.probe import probe_movie
from flowsculpt.render.post.image import read_exr
from flowsculpt.render.scene.aovs import RenderedFrame
from flowsculpt.render.scene.scene_lights import LIGHTS, groups_in
from tests.conftest import TINY, ProjectFolder, commanded

HALF = (0.5, 0.5, 0.5)
NAME, SIZE = "T010_tiny", ("-q", "draft", "--scale", "10%", "-f", "1-2")
HOME = Path("renders") / NAME / "draft.scale10"


@pytest.fixture(scope="module")
def rendered_project(tmp_path_factory: pytest.TempPathFactory) -> ProjectFolder:
    """A shot with light groups, of which two tiny frames are finished, with layers for compositing."""
    project = ProjectFolder(tmp_path_factory.mktemp("relit"))
    project.shot.parent.mkdir()
    project.shot.write_text(TINY + "light_groups: {warm: [key, back]}\n")
    done = project.run("render", NAME, *SIZE, "--layers", "nuke")
    assert done.code == 0, done.err
    return project


@pytest.fixture
def relit(rendered_project: ProjectFolder, monkeypatch: pytest.MonkeyPatch) -> ProjectFolder:
    monkeypatch.chdir(rendered_project.path)
    return rendered_project


def relight(project: ProjectFolder, *words: str) -> tuple[int, str]:
    return commanded(project.path, "relight", NAME, *(() if "-f" in words else SIZE), *words)


def frame(place: Path) -> RenderedFrame:
    return read_exr(place / "frames" / f"{NAME}.0002.exr")[0]


@pytest.mark.renderer
def test_lights_of_finished_frames_take_factors_and_colours(relit: ProjectFolder) -> None:
    code, words = relight(relit, "--set", "lights.warm=0.5", "--set", "lights.rim=2,1,0")
    place = HOME / "relight" / "warm0.5_rim2-1-0"
    assert code == 0 and words.startswith(f"{place / NAME}.1-2.mp4: 2 frames, 2 relit in")
    finished, mixed = frame(HOME), frame(place)
    groups = groups_in(finished.arrays)
    factors = {"warm": 0.5, "rim": np.array([2.0, 1.0, 0.0])}
    expected = sum(factors.get(name, 1.0) * light for name, light in groups.items())
    assert np.allclose(mixed["beauty"], expected, rtol=1e-3)
    total = sum(groups.values(), np.zeros_like(finished["beauty"])).astype(np.float16)
    assert np.array_equal(total, finished["beauty"]) and np.array_equal(mixed["alpha"], finished["alpha"])
    assert probe_movie(place / f"{NAME}.1-2.mp4").frames == 2
    from flowsculpt.pipeline.plugins.maintenance.store_repair import output_folder

    assert output_folder(place / "frames" / f"{NAME}.0002.exr")[0].command == "relight {shot} {quality} …"


@pytest.mark.renderer
def test_relighting_goes_on_where_it_ended_and_names_its_folder(relit: ProjectFolder) -> None:
    assert relight(relit, "--set", "lights.sky=3", "--name", "dusk", "-f", "1", *SIZE[:4])[0] == 0
    code, words = relight(relit, "--set", "lights.sky=3", "--name", "dusk")
    assert code == 0 and "2 frames, 1 relit" in words and (HOME / "relight" / "dusk").is_dir()
    assert "2 frames, 0 relit" in relight(relit, "--set", "lights.sky=3", "--name", "dusk")[1]


@pytest.mark.renderer
def test_frames_finished_with_layers_and_relit_ones_are_delivered_and_reviewed(relit: ProjectFolder) -> None:
    dark = [word for light in ("warm", "rim", "sky") for word in ("--set", f"lights.{light}=0")]
    assert relight(relit, *dark, "--name", "dark", "-f", "1", *SIZE[:4])[0] == 0
    code, words = commanded(relit.path, "deliver", NAME, *SIZE, "--relit", "dark", "--dry-run")
    assert code == 0 and words.startswith("Nothing to be done.")  # the frames have the layers they have
    code, words = commanded(relit.path, "deliver", NAME, *SIZE, "--relit", "dark", "--as", "ffv1")
    movie = HOME / "deliver" / f"{NAME}.dark.1-2.ffv1.mkv"
    assert code == 0 and words.startswith(f"{movie}: 2 frames")
    with av.open(str(relit.path / movie)) as file:  # frame 2 is relit for it
        assert all(not picture.to_ndarray(format="rgb24").any() for picture in file.decode(video=0))
    code, words = commanded(relit.path, "deliver", NAME, *SIZE, "--relit", "dusky")
    assert code == 3 and "relit frames dusky at draft.scale10. There are: dark" in words

    code, words = commanded(relit.path, "review", NAME, "--json")
    faults = json.loads(words[words.index("{") :])["not_as_asked_for"]
    assert code == 0 and not {1, 2} & set(faults[f"{NAME} draft.scale10"])
    data = (relit.path / "renders" / "review" / NAME / "data.js").read_text()
    assert '"label":"draft.scale10 relit dark"' in data.replace(": ", ":")


@pytest.mark.renderer
def test_relit_frames_of_different_factors_are_no_version(relit: ProjectFolder) -> None:
    for frame_number, factor in (("1", "2"), ("2", "3")):
        words = ("--set", f"lights.rim={factor}", "--name", "two", "-f", frame_number, *SIZE[:4])
        assert relight(relit, *words)[0] == 0
    code, words = commanded(relit.path, "deliver", NAME, *SIZE, "--relit", "two")
    assert code == 1 and "relight/two: its frames were relit with different factors." in words


@pytest.mark.renderer
def test_the_shot_file_can_say_the_same(relit: ProjectFolder) -> None:
    words = relight(relit, "--set", "lights.warm=1.5", "--set", "lights={intensity: {sky: 2}}", "--dry-run")[
        1
    ]
    assert "frame 1-2 is not finished" in words  # a setting of the shot gives other frames
    words = relight(relit, "--set", "lights.warm=1.5")[1]
    assert "write lights: {rig: studio, intensity: {key: 1.5, back: 1.5}} in shots/T010_tiny.yaml" in words


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"sky": HALF, "background": HALF}, "write lights: {rig: daylight, intensity: {sky: 0.5}}"),
        ({"sky": HALF}, "in shot.yaml. Only relit frames can show a sky brighter or darker than its light."),
        ({"background": (2.0, 1.0, 1.0)}, "Only relit frames can show"),
        (
            {"sun": (2.0, 1.0, 1.0)},
            "sun: the colour of daylight and of an hdri cannot be set; write softboxes or a sky",
        ),
    ],
)
def test_a_sky_is_seen_as_bright_as_it_shines(factors: dict, words: str, tmp_path: Path) -> None:
    (tmp_path / "shot.yaml").write_text("lights: daylight\n")
    told = permanent(tmp_path / "shot.yaml", (), LIGHTS["daylight"].grouped({}), factors)
    assert words in told.replace(f"{tmp_path}/", "")
    assert ("Only relit" in told) == (factors.get("sky") != factors.get("background"))


@pytest.mark.renderer
@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (("--set", "lights.wram=2"), 2, "has no light group wram. Did you mean 'warm'?"),
        (("--set", "lights.key=2"), 2, "has no light group key. It is in group warm: set lights.warm."),
        (("--set", "lights.rim=bright"), 2, "'bright' is not a factor from 0 to 1e6. Write a number"),
        (("--set", "lights.rim=-1"), 2, "'-1' is not a factor"),
        (
            ("--set", "lights.intensity.rim=2"),
            2,
            "Scale the rendered light by a factor instead: lights.rim=2",
        ),
        ((), 2, "no light is set. Write, for example, --set lights.warm=1.4; the light groups of"),
        (("--set", "lights.rim=2", "--name", "a b"), 2, "--name a b: a version has letters"),
        (
            ("--set", "lights.rim=2", "-f", "2-3", *SIZE[:4]),
            3,
            "frame 3 is not finished at draft.scale10, so it cannot be relit. Render it first: flowsculpt "
            "render T010_tiny "
            "-q draft --scale 10% --set 'layers=nuke' -f 3",
        ),
        (
            ("--set", "light_groups=off", "--set", "lights.rim=2"),
            2,
            "has no light groups, so its frames cannot be relit. Write light_groups: each in the file",
        ),
    ],
)
def test_mistakes_are_told_with_what_helps(
    words: tuple[str, ...], code: int, message: str, relit: ProjectFolder
) -> None:
    answer = relight(relit, *words)
    assert answer[0] == code and message in answer[1] and len(answer[1].splitlines()) == 1

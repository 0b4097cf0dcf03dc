"""Commands in the docs: the command line takes every one, and those of a show work one after another."""

import contextlib
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command

from flowsculpt.pipeline.cli.app import command_line, command_named, command_words
from flowsculpt.pipeline.mesh import icosphere
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.production.request.lookup import QualityName
from tests.conftest import commanded
from tests.needed_plugins import SHIPPED, needs_plugins

ROOT = Path(__file__).parents[2]
FROM_OTHERS = sorted((ROOT / "docs").glob("from-*.md"))
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
YOUR_SHOW, TUTORIAL = ROOT / "docs" / "your-show.md", ROOT / "docs" / "tutorial.md"
ALL = command_words()

BLOCK = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
SPAN = re.compile(r"`(?:\.venv/bin/)?(flowsculpt\s[^`]*)`")
PLACEHOLDERS = {"COMMAND": "status", "FRAME": "1"}

OUTSIDE = {"git", "make", "source"}
"""Programs beside flowsculpt that the pages call: to install and to upgrade."""

AS_WRITTEN = {"new", "validate", "flows", "status", "versions", "doctor", "resample"}
"""Commands that take a second or two."""

OF_A_SAMPLE = {"greet", "export txt", "export"}
"""Commands of the plug-in in docs/plugins.md, which tests/test_plugin.py calls; and the group alone."""

EVERYTHING = needs_plugins(*SHIPPED)
"""Marks what follows whole pages, whose commands are of most plug-ins."""

WIND = f"""\
<VTKFile type="ImageData"><ImageData WholeExtent="0 2 0 2 0 2" Origin="-2 -2 -2" Spacing="2 2 2">
<Piece Extent="0 2 0 2 0 2"><PointData Vectors="wind">
<DataArray type="Float64" Name="wind" NumberOfComponents="3" format="ascii">{"0.1 " * 81}</DataArray>
</PointData></Piece></ImageData></VTKFile>
"""

OF_RESULTS = {"audit", "figures", "publish", "relight", "reproduce", "review", "verify"}
"""Commands that need rendered frames, or all of a store, even with --dry-run."""


def commands_of(text: str) -> list[str]:
    """Return the lines of a page that begin with flowsculpt: in blocks, and in spans of its text."""
    found = []
    for _, block in BLOCK.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            found += re.findall(r"^(?:\S*/)?(flowsculpt(?: .*)?)$", line.partition(" #")[0].strip())
    return [*found, *(" ".join(span.split()) for span in SPAN.findall(BLOCK.sub("", text)))]


def require_parsed(line: str) -> None:
    """Parse a line as the command line does, unless the plug-in of its command is missing.

    Raises errors of the command line for unknown commands, options and words.
    """
    words = [PLACEHOLDERS.get(word, word) for word in shlex.split(line)[1:]]
    group = get_command(command_line())
    context = group.context_class(group, info_name="flowsculpt")
    _, rest, _ = group.make_parser(context).parse_args(words)
    if not rest:
        return
    count = 2 if rest[0] == "export" else 1
    called = " ".join(rest[:count])
    if called in OF_A_SAMPLE:
        return
    if plugins().lacking(f"flowsculpt {called}"):
        return
    assert called in ALL, f"{line}: there is no command {called!r}"
    command = command_named(called)
    inner = command.context_class(command, info_name=called, parent=context)
    given, left, _ = command.make_parser(inner).parse_args(rest[count:])
    assert not left, f"{line}: {left} is too much"
    qualities = given.get("quality") or []
    for quality in [qualities] if isinstance(qualities, str) else qualities:
        assert QualityName.of(quality).is_known or quality.isupper(), f"{line}: {quality} is not a quality"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_command_line_takes_every_command_of_a_page(page):
    for line in commands_of(page.read_text()):
        require_parsed(line)


def test_most_pages_show_commands():
    assert sum(bool(commands_of(page.read_text())) for page in PAGES) > 0.5 * len(PAGES)


@pytest.mark.parametrize("command", ALL)
def test_the_command_line_takes_every_command_of_its_help(command):
    for line in SPAN.findall(command_named(command).help):
        require_parsed(" ".join(line.split()))


def test_a_wrong_command_in_a_page_would_be_noticed():
    for line in ("flowsculpt rendr A", "flowsculpt render A --scal 50%", "flowsculpt film -q best"):
        (found,) = commands_of(f"```\n{line}  # a comment\n```\n")
        with pytest.raises(Exception, match=r"rendr|--scal|best"):
            require_parsed(found)


class Reader:
    """Does what a page says, line by line, in an empty folder.

    quick  True to plan what would take longer than seconds; of stills the first is drawn
    """

    def __init__(self, folder: Path, quick: bool) -> None:
        self.folder, self.quick, self.drawn = folder, quick, False

    def follow(self, page: str) -> None:
        for language, block in BLOCK.findall(page):
            first, _, _ = block.partition("\n")
            if language == "yaml" and first.startswith("# shots/"):
                (self.folder / first.removeprefix("# ")).write_text(block)
            if language == "python" and "\nfrom flowsculpt import" in block:
                exec(block, {})
            for line in block.splitlines() if not language else ():
                self._do(shlex.split(line, comments=True))

    def _do(self, words: list[str]) -> None:
        if words[:1] == ["cd"]:
            self.folder = self.folder / words[1]
        elif words[:1] == ["flowsculpt"]:
            self._command(words[1:])
        else:
            assert not words or words[0] in OUTSIDE or "/" in words[0], words

    def _command(self, words: list[str]) -> None:
        if "--live" in words or (self.quick and words[0] in OF_RESULTS):
            return
        draws = words[0] == "preview" and "--at" in words and not self.drawn
        self.drawn |= draws
        if self.quick and words[0] not in AS_WRITTEN and not draws:
            words = [*words, "--dry-run"]
        elif not self.quick:  # the pictures of a day's work, in minutes
            words = ["draft" if word in ("daily", "final") else word for word in words]
        if self.quick:
            with contextlib.chdir(self.folder):
                code, said = commanded(Path(), *words)
        else:
            command = [sys.executable, "-m", "flowsculpt", "--no-progress", "-j", "2", *words]
            done = subprocess.run(command, cwd=self.folder, capture_output=True, text=True, timeout=3000)
            code, said = done.returncode, done.stdout + done.stderr
        assert code == 0 and "Traceback" not in said, (words, said)


@pytest.fixture
def beside(tmp_path: Path) -> Path:
    """A folder outside of any clone, with a model and winds."""
    from flowsculpt.pipeline.plugins.interchange.mesh_writers import write_mesh

    write_mesh(icosphere(12), tmp_path / "bunny.obj")
    axis = np.linspace(-2.0, 2.0, 3)
    np.savez(tmp_path / "wind.npz", x=axis, y=axis, z=axis, velocity=np.full((3, 3, 3, 3), 0.1))
    for name in ("wind.vti", "wind_1.vti", "wind_2.vti"):
        (tmp_path / name).write_text(WIND)
    return tmp_path


@EVERYTHING
@pytest.mark.slow
def test_a_show_can_be_begun_as_its_page_says(beside):
    Reader(beside, quick=True).follow(YOUR_SHOW.read_text())
    assert sorted(path.name for path in (beside / "my_show/renders/A010_first/preview").iterdir())


@EVERYTHING
@pytest.mark.slow
def test_the_tutorial_can_be_begun_as_its_page_says(tmp_path):
    Reader(tmp_path, quick=True).follow(TUTORIAL.read_text())
    assert "wrung" in (tmp_path / "first_film/shots/A010_first.yaml").read_text()


@EVERYTHING
@pytest.mark.slow
@pytest.mark.parametrize("page", FROM_OTHERS, ids=lambda page: page.stem)
def test_the_way_from_another_program_can_be_begun_as_its_page_says(beside, page):
    assert page.read_text().count("\n") <= 60, "it is one screen"
    reader = Reader(beside, quick=True)
    reader.drawn = True  # the soak test below draws
    reader.follow(page.read_text())
    with contextlib.chdir(beside / "my_show"):
        code, said = commanded(Path(), "validate")
    assert code == 0, said


@EVERYTHING
@pytest.mark.soak
@pytest.mark.parametrize("page", FROM_OTHERS, ids=lambda page: page.stem)
def test_the_way_from_another_program_and_back_works_as_its_page_says(beside, page):
    Reader(beside, quick=False).follow(page.read_text())


@EVERYTHING
@pytest.mark.soak
def test_the_tutorial_ends_with_its_film_and_nothing_left_to_do(tmp_path):
    Reader(tmp_path, quick=False).follow(TUTORIAL.read_text())
    assert (tmp_path / "first_film/renders/film/draft/film.mp4").is_file()
    with contextlib.chdir(tmp_path / "first_film"):
        assert "Nothing to be done" in commanded(Path(), "film", "--dry-run")[1]


@EVERYTHING
@pytest.mark.soak
def test_a_show_can_be_rendered_and_published_as_its_page_says(beside):
    Reader(beside, quick=False).follow(YOUR_SHOW.read_text())
    assert (beside / "my_show/renders/published/A020_bunny/v001/A020_bunny.mp4").is_file()
    assert (beside / "my_show/renders/film/draft/film.mp4").is_file()


@EVERYTHING
@pytest.mark.slow
def test_the_readme_shows_commands_that_can_be_planned_in_the_clone(tmp_path, monkeypatch):
    monkeypatch.chdir(ROOT)
    block = next(block for _, block in BLOCK.findall((ROOT / "README.md").read_text()) if "--show" in block)
    for line in block.splitlines():
        words = shlex.split(line, comments=True)[1:]
        is_of_model = any(word.endswith(".obj") for word in words)
        if words[0] in OF_RESULTS or {"slurm", "--store"} & set(words) or is_of_model:
            continue  # they need rendered frames, another package, a bucket, or a model
        some = ("A020_lorenz", "A030_taffy") if words == ["validate"] else ()
        code, said = commanded(tmp_path, "--dry-run", *words, *some)
        assert code == 0, (line, said)


@EVERYTHING
@pytest.mark.soak
def test_the_first_frame_of_every_shot_of_the_clone_is_good(tmp_path, monkeypatch):
    """Takes 20 CPU seconds; tests/shot/test_gallery.py reads them all in the default suite."""
    monkeypatch.chdir(ROOT)
    code, said = commanded(tmp_path, "validate")
    assert code == 0, said

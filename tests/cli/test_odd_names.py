"""Names of files as users have them: shown as they are, or refused in one line."""

from __future__ import annotations

import subprocess
import sys
from contextlib import chdir
from pathlib import Path

import pytest

from flowsculpt.pipeline.cli.output import empty_table as empty_table
from flowsculpt.pipeline.cli.output import err, out, progress_bars
from flowsculpt.pipeline.errors import UsageError
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.render.base.atomic_write import atomic_write
from tests.conftest import ProjectFolder

OBJ = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


def test_a_root_whose_name_breaks_the_line_is_refused(
    project: ProjectFolder, capfd: pytest.CaptureFixture[str]
) -> None:
    done = project.call("--root", "two\nlines", "simulate", "T010_tiny")
    said = done.err + capfd.readouterr().err
    assert done.code == 2 and "two\\nlines': a line break" in said and said.count("\n") == 1


def test_brackets_in_names_are_no_markup(capfd: pytest.CaptureFixture[str]) -> None:
    rows = empty_table("name", "[b]head")
    rows.add_row("part [red] v2", "[/]")
    for console in (out, err):
        with console.capture() as captured:
            console.print(rows)
            console.print("[red] alone")
        assert "part [red] v2" in captured.get() and "[b]head" in captured.get() and "[/]" in captured.get()
        assert "[red] alone" in captured.get()
    with progress_bars(wanted=False) as bar, err.capture() as captured:
        err.print(bar("making [red]", 1).progress.get_renderable())
    assert "making [red]" in captured.get()


FOLDERS = ['it\'s "{x}" of $HOME; ü & 50% (b) [c]']
FOLDERS += [
    pytest.param(name, marks=pytest.mark.soak)
    for name in (
        "My Films",
        "-j",
        "dot. ",
        "M" * 200,
        "日本" * 40,
        "`id`",
        "a\\b",
        "{{y}}",
        "%(x)s %d",
        "~",
        "#1,2=3",
    )
]


@pytest.mark.parametrize("name", FOLDERS)
def test_an_installation_in_a_folder_of_any_name_simulates(name: str, project: ProjectFolder) -> None:
    """Snakemake's shell commands hold the path of Python, and fill in names in braces."""
    home = project.path / name
    home.mkdir()
    (home / "env").symlink_to(sys.prefix)
    words = ["--root", home / "root", "simulate", "T010_tiny", "-f", "1"]
    command = [home / "env/bin/python", home / "env/bin/flowsculpt", "--no-progress", *words]
    done = subprocess.run(command, cwd=project.path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert [*home.glob("root/renders/T010_tiny/meshes/*.npz")]


def test_a_name_of_the_greatest_length_can_be_written(tmp_path: Path) -> None:
    for name in ("M" * 251 + ".obj", "日" * 83 + ".obj"):
        with atomic_write(tmp_path / name) as draft:
            draft.write_text(OBJ)
        assert [*tmp_path.iterdir()] == [tmp_path / name]
        (tmp_path / name).unlink()


def test_a_command_to_copy_quotes_the_file_it_names(project: ProjectFolder) -> None:
    with chdir(project.path), pytest.raises(UsageError, match=r"--model 'my model\.obj' makes"):
        Show().find_shot("my model.obj")

"""Tab completes what can be typed, in real shells."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.plugins.completion import tab_answers as completion
from flowsculpt.pipeline.plugins.completion.tab_answers import answer, completions
from tests.cli.test_start_up import HEAVY
from tests.conftest import ProjectFolder

COMMANDS: dict[str, Any] = {
    "": {
        "options": {"--json": [None, "Answer in JSON"], "-j": [[], "Use N cores"]},
        "words": [["render\tRender frames", "export\tWrite a shot"]],
    },
    "render": {
        "options": {
            "-q": [["draft", "daily", "final"], "One of these"],
            "--quality": [["draft", "daily", "final"], "One of these"],
            "--set": [["look=clay", "look=glass"], "Replace a value"],
        },
        "words": [[completion.SHOTS]],
    },
    "export": {"options": {}, "words": [["ply\tWrite PLY", "obj\tWrite OBJ"]]},
    "export ply": {"options": {"-o": [[completion.FILES], "Write"]}, "words": [[completion.SHOTS]]},
}


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("", ["render", "export"]),
        ("re", ["render"]),
        ("-j 2 re", ["render"]),
        ("render ", ["T010_tiny", "T020"]),
        ("render T010_tiny T02", ["T020"]),
        ("render -q d", ["draft", "daily"]),
        ("render T020 -q ", ["draft", "daily", "final"]),
        ("render --quality=f", ["--quality=final"]),
        ("render --set look=g", ["look=glass"]),
        ("render --q", ["--quality"]),
        ("render --js", ["--json"]),
        ("--json", ["--json"]),
        ("export p", ["ply"]),
        ("export ply T02", ["T020"]),
        ("export ply T020 -o fi", [completion.FILES]),
        ("render other/", [completion.FILES]),
        ("nothing ", []),
        ("render -j ", []),
    ],
)
def test_a_word_completes_to_what_may_stand_there(
    project: ProjectFolder, monkeypatch: pytest.MonkeyPatch, line: str, found: list[str]
) -> None:
    (project.path / "shots/T020.yaml").write_text("extends: T010_tiny\n")
    (project.path / "shots/defaults.yaml").write_text("rate: 24\n")
    monkeypatch.chdir(project.path)
    *words, last = line.split(" ")
    assert [each.partition("\t")[0] for each in completions(COMMANDS, [*words, last])] == found


PROGRAM = Path(sys.executable).with_name("flowsculpt")


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """An environment with a cache of its own, which holds the table of the commands."""
    folder = tmp_path_factory.mktemp("cache")
    surroundings = {**os.environ, "XDG_CACHE_HOME": str(folder), completion.VARIABLE: "bash"}
    subprocess.run([PROGRAM, "st"], env=surroundings, check=True, capture_output=True)
    del surroundings[completion.VARIABLE]
    yield surroundings


@pytest.fixture(scope="module")
def scripts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The script of each shell."""
    folder = ProjectFolder(tmp_path_factory.mktemp("scripts"))
    return {shell: folder.call("completion", shell).out for shell in ("bash", "zsh", "fish")}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "found"),
    [
        (["vali"], ["validate"]),
        (["render", "T010"], ["T010_tiny"]),
        (["render", "--quality", "=", "fi"], ["final"]),
        (["validate", "f"], ["film"]),
        (["flows", "vortex_"], ["vortex_ring"]),
        (["validate", "T010_tiny", "--set", "look", "=", "cl"], ["clay"]),
        (["new", "A", "--model", "shots/T"], ["shots/T010_tiny.yaml"]),
    ],
)
def test_bash_completes_commands_shots_and_names(
    project: ProjectFolder, cache: dict[str, str], scripts: dict[str, str], words: list[str], found: list[str]
) -> None:
    line = " ".join(map(shlex.quote, [str(PROGRAM), *words]))
    script = (
        f"{scripts['bash']}\nCOMP_WORDS=({line}) COMP_CWORD={len(words)}\n"
        f'_flowsculpt {PROGRAM} "${{COMP_WORDS[-1]}}" ""\nprintf "%s\\n" "${{COMPREPLY[@]}}"'
    )
    shell = ["bash", "--norc", "-c", script]
    done = subprocess.run(shell, cwd=project.path, env=cache, capture_output=True, text=True, check=True)
    assert set(found) <= set(done.stdout.splitlines())


@pytest.mark.slow
def test_scripts_have_no_mistakes_of_syntax(scripts: dict[str, str]) -> None:
    for shell, script in scripts.items():
        assert completion.VARIABLE in script and completion.FILES in script
        if program := shutil.which(shell):
            subprocess.run([program, "-n"], input=script, text=True, check=True)


@pytest.mark.slow
def test_an_answer_imports_nothing_that_takes_time(cache: dict[str, str], tmp_path: Path) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit('a module of the show')")
    ask = "import sys; from flowsculpt.__main__ import main; main(); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", ask, "ren"],
        env={**cache, completion.VARIABLE: "fish"},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith("render\tRender frames")
    assert not {*HEAVY, "typer", "rich", "pydantic", "dataclasses"} & set(done.stderr.split())


def test_a_table_of_other_code_or_a_damaged_one_gives_no_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import json

    file, code = tmp_path / "table.json", tmp_path / "plugin.py"
    code.write_text("1")
    monkeypatch.setattr(completion, "table_file", lambda: str(file))
    assert not answer(["re"])
    table = {"packages": completion.packages(), "files": completion.states([str(code)]), "commands": COMMANDS}
    file.write_text(json.dumps(table))
    assert answer(["re"]) and capsys.readouterr().out == "render\tRender frames\n"
    code.write_text("10")
    assert not answer(["re"])
    for damage in ("", "{", "[]", '{"packages": 1}'):
        file.write_text(damage)
        assert not answer(["re"])

"""Plug-ins of strangers: what they add works, and one that is broken costs a line and nothing else."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from pipeline.plugin import API
from tests.conftest import TINY

GREETER = """\
from pipeline.plugin import Command, Plugin

PLUGIN = Plugin("greeter", "1.2", commands={"greet": Command("greeter:greet", "Greet a shot.", "Look")},
                exporters={"txt": Command("greeter:txt", "The name of a shot.")})


def greet(common, shot: str) -> None:
    \"\"\"Greet a shot: `flowsculpt greet A010`.\"\"\"
    print("Hello", shot)


def txt(common, shot: str) -> None:
    \"\"\"Write the name of a shot: `flowsculpt export txt A010`.\"\"\"
    (common.root / f"{shot}.txt").write_text(shot)
"""


class Environment:
    """A folder in Python's search path with installed plug-ins."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def install(self, name: str, text: str) -> None:
        (self.folder / f"{name}.py").write_text(text)
        info = self.folder / f"{name}-1.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1\n")
        (info / "entry_points.txt").write_text(f"[flowsculpt.plugins]\n{name} = {name}:PLUGIN\n")

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        environment = {**os.environ, "PYTHONPATH": str(self.folder), "COLUMNS": "120"}
        call = [sys.executable, "-m", "pipeline.cli", *words]
        return subprocess.run(call, cwd=self.folder, env=environment, capture_output=True, text=True)


@pytest.fixture
def environment(tmp_path: Path) -> Environment:
    return Environment(tmp_path)


def test_a_command_and_a_format_of_an_installed_plug_in_are_called_like_those_of_flowsculpt(environment):
    environment.install("greeter", GREETER)
    assert "Greet a shot." in environment.run("--help").stdout
    assert environment.run("greet", "A010").stdout == "Hello A010\n"
    assert environment.run("export", "txt", "A010").returncode == 0
    assert (environment.folder / "A010.txt").read_text() == "A010"


def test_the_plug_in_of_the_docs_works(environment):
    page = (Path(__file__).parents[1] / "docs" / "plugins.md").read_text(encoding="utf-8")
    (metadata,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    (text,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    ((name, place),) = tomllib.loads(metadata)["project"]["entry-points"]["flowsculpt.plugins"].items()
    assert (name, place) == ("greeter", "greeter:PLUGIN")
    environment.install(name, text)
    (environment.folder / "shots").mkdir()
    (environment.folder / "shots" / "A010_box.yaml").write_text(TINY)
    done = environment.run("greet", "A010_box")
    assert done.stdout == "A box, twisted\n", done.stderr
    assert environment.run("export", "txt", "A010_box").returncode == 0
    assert (environment.folder / "A010_box.txt").read_text().split() == list("123456")
    assert "Greet a shot." in environment.run("--help").stdout


def plugin(name: str = "greeter", rest: str = "") -> str:
    return f"from pipeline.plugin import Command, Plugin\nPLUGIN = Plugin({name!r}, '1'{rest})\n"


@pytest.mark.parametrize(
    ("name", "text", "fault"),
    [
        ("broken", "import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
        ("later", plugin("later", f", api={API + 1}"), f"it is built for version {API + 1} of the API"),
        ("none", "PLUGIN = 3", "none:PLUGIN is not a pipeline.plugin.Plugin"),
        ("twin", plugin("greeter"), "there is another plug-in greeter; uninstall one of the two"),
        (
            "rival",
            plugin("rival", ", commands={'greet': Command('rival:greet', '')}"),
            "plug-in greeter adds command greet too; uninstall one of the two",
        ),
        (
            "usurper",
            plugin("usurper", ", commands={'review': Command('usurper:review', '')}"),
            "plug-in review adds command review too; uninstall one of the two",
        ),
        (
            "core",
            plugin("core", ", commands={'render': Command('core:render', '')}"),
            "plug-in flowsculpt adds command render too; uninstall one of the two",
        ),
    ],
)
def test_a_plug_in_that_cannot_be_used_is_told_in_a_line_and_the_others_work(environment, name, text, fault):
    environment.install("greeter", GREETER)
    environment.install(name, text)
    done = environment.run("greet", "A010")
    assert done.returncode == 0 and done.stdout == "Hello A010\n"
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"plug-in {name}") and "is left out: " in line and fault in line


def test_an_installation_older_than_the_code_is_told_with_its_remedy(environment):
    info = environment.folder / "flowsculpt-0.0.9.dist-info"  # comes before the one that is installed
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: flowsculpt\nVersion: 0.0.9\n")
    done = environment.run("status")
    assert done.returncode == 4 and "install it again: make setup" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_the_version_is_printed_without_importing_a_plug_in(environment):
    environment.install("broken", "raise SystemExit('imported')")
    done = environment.run("--version")
    assert done.returncode == 0 and done.stdout.startswith("flowsculpt ") and not done.stderr

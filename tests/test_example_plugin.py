"""The plug-in of examples/plugin and that of docs/plugins.md, installed into an environment of their own."""

from __future__ import annotations

import importlib.util
import json
import math
import os
import re
import shutil
import site
import subprocess
import sys
import uuid
import venv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from flowsculpt.render.post.image import read_exr
from tests.command_server import COMMANDS
from tests.conftest import forking_with_plugins
from tests.needed_plugins import needs_plugins
from tests.production.farm.test_clusters import SUBMIT, write_profile

HERE = Path(__file__).parents[1]
EXAMPLE = HERE / "examples" / "plugin"
SHOT = """\
title: A combed slab
frames: 1-2
subject: {solid: box, size: [2, 0.4, 2]}
resample: {max_edge_length: 0.3}
flows: [{marbling.comb: {strength: 2}}]
look: marbling.inks
marbling: {mist: {density: 0.2}}
camera: {elevation: 40}
"""
FILM = "title: Slab\nshots: [M020_slab]\ntitle_seconds: 0\ncredits_seconds: 0\n"
FILM_COMMAND = ("--json", "film", "-q", "draft.scale10", "--no-preview")


@dataclass(frozen=True)
class Installed:
    """An environment with flowsculpt and what is installed into it, and a working folder."""

    environment: Path
    show: Path

    def pip(self, *words: str) -> None:
        command = [
            sys.executable,
            "-m",
            "pip",
            "--python",
            str(self.environment / "bin" / "python"),
            "--quiet",
        ]
        subprocess.run([*command, *words], cwd=self.show, check=True)

    def install(self, *words: str) -> None:
        self.pip("install", "--no-index", "--no-deps", "--no-build-isolation", *words)

    @property
    def search_path(self) -> str:
        """The folders in which Python of this environment finds what was installed into it."""
        (packages,) = self.environment.glob("lib/python*/site-packages")
        editable = [path.read_text().strip() for path in packages.glob("_*.pth")]
        return os.pathsep.join([str(packages), *editable])

    def run(
        self, *words: str, by_its_python: bool = False, **variables: str
    ) -> subprocess.CompletedProcess[str]:
        """Run a command by the Python of this environment, or fork one with the same search path."""
        environment = {**os.environ, "COLUMNS": "150", **variables}
        python = str(self.environment / "bin" / "python")
        if COMMANDS.is_on and not by_its_python:
            python, environment["PYTHONPATH"] = sys.executable, self.search_path
        command = [python, "-m", "flowsculpt", "--no-progress", *words]
        with forking_with_plugins():
            return subprocess.run(
                command, cwd=self.show, env=environment, capture_output=True, text=True, timeout=300
            )

    def done(self, *words: str, by_its_python: bool = False, **variables: str) -> str:
        done = self.run(*words, by_its_python=by_its_python, **variables)
        assert done.returncode == 0, done.stderr
        return done.stdout


def environment_in(folder: Path) -> Installed:
    """Return an environment without pip that has the packages of this one."""
    venv.create(folder / "env")
    (packages,) = (folder / "env").glob("lib/python*/site-packages")
    (packages / "others.pth").write_text(f"import site; site.addsitedir({site.getsitepackages()[0]!r})")
    (folder / "show").mkdir()
    return Installed(folder / "env", folder / "show")


@pytest.fixture(scope="module")
def marbling(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """The example, installed, and a film of two frames, made."""
    installed = environment_in(tmp_path_factory.mktemp("marbling"))
    package = shutil.copytree(EXAMPLE, installed.show.parent / "package")
    installed.install(str(package))
    shutil.copytree(EXAMPLE / "shots", installed.show / "shots")
    (installed.show / "shots" / "M020_slab.yaml").write_text(SHOT)
    (installed.show / "shots" / "film.yaml").write_text(FILM)
    facts = json.loads(installed.done(*FILM_COMMAND))
    assert facts["made"]["marbling.mist"] == 2 == facts["made"]["finish"]
    return installed


@needs_plugins("maintenance")
@pytest.mark.renderer
def test_the_example_goes_from_shot_file_to_film(marbling: Installed) -> None:
    home = marbling.show / "renders"
    assert (home / "film" / "draft.scale10" / "film.mp4").stat().st_size > 1000
    raw, misty = (
        read_exr(home / "M020_slab" / "draft.scale10" / folder / "M020_slab.0002.exr")[0]
        for folder in ("raw", "marbling.mist")
    )
    light = np.exp(-0.2 * raw["depth"].reshape(*raw["beauty"].shape[:2], 1))
    lost = raw["beauty"] * light + (1 - light) * np.float32([0.05, 0.06, 0.08])
    assert np.abs(misty["beauty"] - lost).max() < 0.01 * raw["beauty"].max()
    assert "1-2   –      –" in marbling.done("status", "M020_slab")
    shot = marbling.show / "shots" / "M020_slab.yaml"
    shot.write_text(SHOT.replace("density: 0.2", "density: 0.3"))
    why = marbling.done("why", "M020_slab", "2", "-q", "draft.scale10")
    assert "settings of marbling.mist differ" in why and "mist.density: 0.2 → 0.3" in why
    left = json.loads(marbling.done("--dry-run", *FILM_COMMAND))
    assert [job["task"] for job in left["jobs"]] == ["marbling.mist", "finish", "assemble", "film"]
    shot.write_text(SHOT)


@needs_plugins("authoring", "delivery")
@pytest.mark.renderer
def test_its_command_format_encode_and_schema_are_there(marbling: Installed) -> None:
    assert marbling.done("inks", by_its_python=True).splitlines()[0] == "0.840 0.800 0.710"
    marbling.done("export", "csv", "M020_slab")
    table = marbling.show / "renders" / "M020_slab" / "csv" / "M020_slab.csv"
    assert table.read_text().startswith("frame,vertices,faces,area\n1,")
    marbling.done("deliver", "film", "-q", "draft.scale10", "--as", "marbling.wall")
    delivered = marbling.show / "renders" / "film" / "draft.scale10" / "deliver" / "film.marbling.wall.mp4"
    assert delivered.stat().st_size > 1000
    schema = json.loads(marbling.done("schema"))
    mist = schema["$defs"]["Mist"]["properties"]
    assert "marbling.inks" in json.dumps(schema) and mist["density"]["description"].startswith("share of")


@pytest.fixture
def s3() -> Iterator[dict[str, str]]:
    from tests.plugins.remote.s3 import CREDENTIALS, serving

    with serving() as proxy:
        yield {**CREDENTIALS, "AWS_ENDPOINT_URL": proxy.url}


@needs_plugins("farm")
@pytest.mark.renderer
def test_exported_jobs_have_its_stage_between_rendering_and_finishing(marbling: Installed) -> None:
    marbling.done("export", "flamenco", "M020_slab", "-q", "draft.scale10")
    settings = json.loads((marbling.show / "flamenco.json").read_text())["settings"]
    steps = [(step["name"], step["frames"], step["after"]) for step in json.loads(settings["steps"])]
    assert steps[2:4] == [("marbling.mist M020_slab", [1, 2], [1]), ("Finish M020_slab", [1, 2], [1, 2])]
    planned = json.loads(marbling.done("--json", "export", "plan", "M020_slab", "-q", "draft.scale10"))
    assert planned["chunks"] == ["render:1-2", "marbling.mist:1-2", "finish:1-2"]


@needs_plugins("farm", "remote")
@pytest.mark.renderer
@pytest.mark.soak
def test_a_farm_does_its_stage_and_a_store_gives_the_film_to_others(marbling, s3, tmp_path) -> None:
    from tests.plugins.remote.s3 import BUCKET

    stand_in = tmp_path / "bsub"
    answer = "Job <{}> is submitted to default queue <normal>."
    stand_in.write_text(SUBMIT.format(python=sys.executable, home=str(tmp_path), answer=answer))
    stand_in.chmod(0o755)
    write_profile(marbling.show, "lsf")
    (marbling.show / "shots" / "M020_slab.yaml").write_text(SHOT.replace("density: 0.2", "density: 0.4"))
    path = {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    far = json.loads(marbling.done(*FILM_COMMAND, "--profile", "lsf", **path))
    assert far["made"] == {"marbling.mist": 2, "finish": 2, "assemble": 2, "film": 2}
    words = [" ".join(json.loads(file.read_text())) for file in tmp_path.glob("*.json")]
    assert len(words) == 2, "the stage and the denoising are jobs of the farm"
    store = ("--store", f"s3://{BUCKET}/{uuid.uuid4().hex}")
    marbling.done("push", *store, **s3)
    assert json.loads(marbling.done("--root", "other", *FILM_COMMAND, *store, **s3))["made"] == {}
    films = [marbling.show / root / "renders/film/draft.scale10/film.mp4" for root in (".", "other")]
    assert films[0].read_bytes() == films[1].read_bytes()


@pytest.mark.renderer
def test_the_shot_of_a_plug_in_that_was_uninstalled_is_refused_with_its_name(marbling: Installed) -> None:
    marbling.pip("uninstall", "-y", "flowsculpt-marbling")
    refused = marbling.run("render", "M020_slab")
    needs = "It needs plug-in marbling, which is not installed (pip install …)."
    assert refused.returncode == 2
    lines = [line.partition(".yaml:")[2] for line in refused.stderr.splitlines()]
    assert lines == [
        f"5:10: flows.0.marbling.comb: unknown name. {needs}",
        f"6:1: look: 'marbling.inks' is not a look. {needs}",
        f"7:1: marbling: unknown name. {needs}",
    ]


def test_the_bound_of_the_examples_gradient_is_the_steepest_slope_across_its_tines() -> None:
    spec = importlib.util.spec_from_file_location("comb", EXAMPLE / "flowsculpt_marbling" / "comb.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["comb"] = module
    spec.loader.exec_module(module)
    for sharpness in (0.1, 2.0, 20.0):
        field = module.Comb(strength=-1.5, spacing=0.7, sharpness=sharpness)
        x = np.linspace(0.0, 0.7, 20_001)
        speed = -1.5 * np.exp(sharpness * (np.cos(2.0 * math.pi * x / 0.7) - 1.0))
        assert field.gradient_bound(0.0) == pytest.approx(np.abs(np.gradient(speed, x)).max(), rel=1e-3)
        along_y = field.velocity(np.stack([x, 0 * x, 0 * x], axis=1), 0.0)[:, 1]
        assert np.abs(along_y - speed).max() < 1e-12


@needs_plugins("authoring", "delivery", "preview")
@pytest.mark.slow
def test_the_commands_of_the_docs_lead_from_an_empty_folder_to_a_flow(tmp_path: Path) -> None:
    page = (HERE / "docs" / "plugins.md").read_text(encoding="utf-8")
    installed = environment_in(tmp_path)
    first = dict(re.findall(r"`([\w/]+\.\w+)`(?:(?!```).)*?\n```\w+\n(.*?)```", page, re.DOTALL)[:3])
    assert list(first) == ["pyproject.toml", "flowsculpt_ripples/__init__.py", "flowsculpt_ripples/flow.py"]
    for name, text in first.items():
        (installed.show / name).parent.mkdir(exist_ok=True)
        (installed.show / name).write_text(text)
    (commands,) = re.findall(r"```console\n(.*?)```", page, re.DOTALL)
    said = []
    for line in commands.splitlines():
        program, *words = line.removeprefix("$ ").split()
        if program == "pip":
            assert words == ["install", "-e", "."]
            installed.install("-e", ".")
        elif program == "mkdir":
            (installed.show / words[0]).mkdir()
        elif program == "cd":
            installed = replace(installed, show=installed.show / words[0])
        else:
            assert program == "flowsculpt"
            said.append(installed.done(*words))
    assert (
        "greatest speed" in said[0]
        and "- ripples.ring:" in (installed.show / "shots/A010_pond.yaml").read_text()
    )
    assert list((installed.show / "renders" / "A010_pond" / "preview").glob("*.png"))
    files = r"`(flowsculpt_ripples/\w+\.py|A020_lagoon\.yaml)`[^:]*:\n\n```\w+\n(.*?)```"
    for name, text in re.findall(files, page, re.DOTALL):
        folder = installed.show / "shots" if name.endswith(".yaml") else installed.show.parent
        (folder / name).write_text(text)
    (installed.show / "shots" / "a.txt").write_text("1\n" * 642)
    scan = "subject={ripples.scan: {heights: a.txt}, fit: 2}"
    assert "ripples.scan" in installed.done("validate", "A020_lagoon", "--set", scan)
    assert installed.done("depths", "A020_lagoon", "-f", "1-2").startswith("1: -1.000\n2: -1.0")
    installed.done("export", "csv", "A020_lagoon", "-f", "1-2")
    table = installed.show / "renders" / "A020_lagoon" / "csv" / "A020_lagoon.csv"
    assert re.fullmatch(r"frame,vertices\n1,\d+\n2,\d+\n", table.read_text())
    delivery = installed.done("--dry-run", "deliver", "A020_lagoon", "--as", "ripples.wall")
    assert "tinting 24 frames" in delivery and "as ripples.wall" in delivery

"""Plug-ins of strangers: what they add works, and one that is broken costs a line and nothing else."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from flowsculpt.pipeline.plugin import Plugin, Plugins, plugins
from flowsculpt.pipeline.plugin_contracts import API
from flowsculpt.pipeline.shot.documents.subject_documents import NAMED
from tests.needed_plugins import needs_plugins

ROOT = Path(__file__).parents[1]

GREETER = """\
from flowsculpt.pipeline.plugin import Command, Plugin

PLUGIN = Plugin("greeter", "1.2", commands={
    "greet": Command("greeter:greet", "Greet a shot.", "Look", also="hail"),
    "export txt": Command("greeter:txt", "The name of a shot."),
})


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
        environment["PYTHONDONTWRITEBYTECODE"] = "1"  # of text that is replaced by as much within a second
        call = [sys.executable, "-m", "flowsculpt", *words]
        return subprocess.run(call, cwd=self.folder, env=environment, capture_output=True, text=True)


@pytest.fixture
def environment(tmp_path: Path, forks_with_plugins: None) -> Environment:
    return Environment(tmp_path)


def test_a_command_and_a_format_of_an_installed_plug_in_are_called_like_those_of_flowsculpt(environment):
    environment.install("greeter", GREETER)
    assert "Greet a shot." in environment.run("--help").stdout
    assert environment.run("greet", "A010").stdout == "Hello A010\n"
    assert environment.run("export", "txt", "A010").returncode == 0
    assert (environment.folder / "A010.txt").read_text() == "A010"
    assert environment.run("hail", "A010").stderr == "unknown command hail. Did you mean greet?\n"


MEDDLING = """\
import locale, os, sys, warnings
from flowsculpt.pipeline.plugin import Plugin
os.chdir("/")
locale.setlocale(locale.LC_ALL, "C")
warnings.simplefilter("error")
print("a greeting")
PLUGIN = Plugin("meddler", "1", extras="meddler_extras:Odd")
"""


@needs_plugins("maintenance")
def test_a_plug_in_that_meddles_when_it_is_imported_changes_nothing(environment):
    environment.install("meddler", MEDDLING)
    done = environment.run("status", "--json")
    assert (done.returncode, done.stdout, done.stderr) == (0, "[]\n", "a greeting\n")


@needs_plugins("authoring")
def test_a_schema_that_is_a_function_is_refused_with_the_name_of_its_plug_in(environment):
    environment.install("meddler", MEDDLING)
    (environment.folder / "meddler_extras.py").write_text(
        "from flowsculpt.api import ShotExtras\n"
        "class Odd(ShotExtras):\n    def schemas(self): return {'odd': print}\n"
    )
    done = environment.run("schema", "odd")
    said = (
        "plug-in meddler: its schema odd is a builtin_function_or_method; it must be a class that extends "
        "pydantic's BaseModel\n"
    )
    assert done.returncode == 4 and done.stderr.endswith(said) and done.stdout == ""


MARBLING = """\
from flowsculpt.pipeline.plugin import Plugin

FLOWS, LOOKS = {"swirl": "marbling_parts:Swirl"}, {"ink": "marbling_parts:INK"}
PLUGIN = Plugin("marbling", "1.0", flows=FLOWS, looks=LOOKS)
"""
PARTS = """\
from dataclasses import dataclass
from typing import Annotated

from flowsculpt.pipeline.flow.parameters import Number, ParameterDoc, number_at
from flowsculpt.pipeline.flow.velocity import ExternalField
from flowsculpt.pipeline.kernels import block_kernel
from flowsculpt.render.scene.materials.models import Plastic

INK = Plastic((0.02, 0.05, 0.2), roughness=0.1)


@block_kernel
def turning(numbers, count, x, y, z, t, u, v, w):
    for i in range(count):
        u[i] -= numbers[0] * z[i]
        w[i] += numbers[0] * x[i]


@dataclass(frozen=True)
class Swirl(ExternalField):
    \"\"\"Turns about the vertical.\"\"\"

    strength: Annotated[Number, ParameterDoc("angular speed", "1/s")] = 1.0
    block = turning

    def numbers(self, time):
        return (number_at(self.strength, time),)

    def gradient_bound(self, time):
        return abs(number_at(self.strength, time))

    def length_scale(self, time):
        return float("inf")
"""
INKED = """\
title: Ink
frames: 1-3
subject: {solid: box}
resample: {max_edge_length: 0.2}
flows: [{marbling.swirl: {strength: 2}}]
look: {material: marbling.ink, roughness: 0.2}
"""


@pytest.fixture
def marbling(environment):
    environment.install("marbling", MARBLING)
    (environment.folder / "marbling_parts.py").write_text(PARTS)
    (environment.folder / "shots").mkdir()
    (environment.folder / "shots" / "A010_ink.yaml").write_text(INKED)
    return environment


@needs_plugins("maintenance")
@pytest.mark.slow
def test_a_shot_is_made_of_a_flow_of_a_plug_in_and_made_again_with_its_next_version(marbling):
    shot, setting = (
        marbling.folder / "shots" / "A010_ink.yaml",
        ("--set", "flows.0.marbling.swirl.strength=3"),
    )
    assert marbling.run("simulate", "A010_ink", *setting).returncode == 0
    shot.write_text(INKED.replace("strength: 2", "strength: 3"))
    assert "1-3   –      –" in marbling.run("status", "A010_ink").stdout
    (marbling.folder / "marbling.py").write_text(MARBLING.replace("1.0", "1.1"))
    assert "1     2-3    –" in marbling.run("status", "A010_ink").stdout, (
        "a version decides what the flow moves"
    )


@pytest.mark.slow
def test_the_version_of_a_plug_in_decides_nothing_of_shots_without_it(marbling):
    shot = marbling.folder / "shots" / "A010_ink.yaml"
    shot.write_text(INKED.replace("marbling.swirl: {strength: 2}", "twist: {amount: 20}"))
    plans = []
    for version in ("1.0", "1.2"):
        (marbling.folder / "marbling.py").write_text(MARBLING.replace("1.0", version))
        plans.append(json.loads(marbling.run("--json", "--dry-run", "simulate", "A010_ink").stdout)["jobs"])
    assert plans[0] == plans[1] and plans[0][0]["job"].startswith("simulate_A010_ink"), (
        "names of jobs hold keys"
    )


@needs_plugins("authoring")
@pytest.mark.slow
def test_flows_and_looks_of_plug_ins_are_listed_completed_and_proposed(marbling):
    assert "marbling.swirl" in marbling.run("flows").stdout
    assert "angular speed" in marbling.run("flows", "marbling.swirl").stdout
    schema = marbling.run("schema").stdout
    assert '"marbling.swirl": {' in schema and '"marbling.ink"' in schema
    text = INKED.replace("marbling.swirl", "swirl").replace("marbling.ink", "marbling.inc")
    (marbling.folder / "shots" / "A010_ink.yaml").write_text(text)
    told = marbling.run("validate").stderr
    assert "flows.0.swirl: unknown name. Did you mean 'marbling.swirl'?" in told
    assert "look.material: 'marbling.inc' is not a look. Did you mean 'marbling.ink'?" in told


@needs_plugins("authoring")
@pytest.mark.slow
def test_a_shot_whose_plug_in_is_missing_or_broken_is_refused_with_its_name(marbling):
    (marbling.folder / "marbling_parts.py").write_text("import no_such_module")
    told = marbling.run("validate").stderr
    missing = "is left out: ModuleNotFoundError: No module named 'no_such_module'"
    assert f"plug-in marbling: marbling.swirl {missing}" in told
    assert f"plug-in marbling: marbling.ink {missing}" in told
    assert "flows.0.marbling.swirl: unknown name. Plug-in marbling could not load it." in told
    (marbling.folder / "marbling.py").write_text("1 / 0")
    assert "It needs plug-in marbling, which did not load" in marbling.run("validate").stderr
    shutil.rmtree(marbling.folder / "marbling-1.dist-info")
    refused = marbling.run("render", "A010_ink")
    assert refused.returncode == 2
    needs = "It needs plug-in marbling, which is not installed (pip install …)."
    assert f"shots/A010_ink.yaml:5:10: flows.0.marbling.swirl: unknown name. {needs}" in refused.stderr
    assert f"look.material: 'marbling.ink' is not a look. {needs}" in refused.stderr


@needs_plugins("authoring")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "wrong", "fault"),
    [
        ("w[i] += numbers[0]", "w[i] += strength", "TypingError: NameError: name 'strength' is not defined"),
        ("u[i] -= numbers[0]", "u[i] -= numbers.first", "TypingError: Unknown attribute 'first' of type"),
        ("(number_at(self.strength, time),)", "(1 / 0,)", "ZeroDivisionError: division by zero"),
        ("abs(number_at", "abs(number_of", "NameError: name 'number_of' is not defined"),
    ],
)
def test_an_error_in_the_code_of_a_flow_is_told_in_a_line_with_its_place(marbling, code, wrong, fault):
    assert code in PARTS
    (marbling.folder / "marbling_parts.py").write_text(PARTS.replace(code, wrong))
    line = 1 + PARTS.partition(code)[0].count("\n")
    place = f"marbling_parts.py:{line}: plug-in marbling: {fault}"
    for command in (["validate"], ["render", "A010_ink", "-q", "draft"]):
        done = marbling.run(*command)
        assert done.returncode in (1, 4) and place in done.stderr, done.stderr
        assert "Traceback" not in done.stderr


@needs_plugins("authoring")
@pytest.mark.slow
@pytest.mark.parametrize(
    ("code", "wrong", "fault"),
    [
        (
            "(number_at(self.strength, time),)",
            "(1.0, np.zeros(3))",
            "flow marbling.swirl: numbers() returned (1.0, array([0., 0., 0.]))",
        ),
        ("(number_at(self.strength, time),)", "(1.0,) * 12", "it must return at most eleven numbers"),
        ('float("inf")', "None", "length_scale() returned None; it must return a number from 0 on"),
        ("abs(number_at", "-abs(number_at", "gradient_bound() returned -2.0; it must return a number from 0"),
        ("z, t, u", "z, u", "turning takes other parameters than numbers, count, x, y, z, t, u, v, w"),
    ],
)
def test_a_flow_that_returns_what_no_flow_has_is_refused_in_a_line(marbling, code, wrong, fault):
    parts = "import numpy as np\n" + PARTS.replace(code, wrong)
    (marbling.folder / "marbling_parts.py").write_text(parts)
    done = marbling.run("validate")
    assert done.returncode in (1, 2, 4) and fault in done.stderr, done.stderr
    assert "plug-in marbling" in done.stderr and "Traceback" not in done.stderr


@needs_plugins("authoring")
@pytest.mark.slow
def test_a_flow_that_lacks_a_method_is_left_out_with_the_name_of_the_method(marbling):
    (marbling.folder / "marbling_parts.py").write_text(PARTS.replace("def length_scale", "def scale"))
    told = marbling.run("validate").stderr
    assert "plug-in marbling: marbling.swirl is left out: it lacks length_scale(time); add it as" in told


STONE = """
import numpy as np
from pydantic import Field
from flowsculpt import TriangleMesh, UsageError, icosphere
from flowsculpt.api import SubjectKind


class Stone(SubjectKind):
    \"\"\"A stone with heights from a file.\"\"\"

    heights: str = Field(description="a file of numbers")
    open: bool = Field(False, description="with a face that is wound the wrong way")

    def files(self):
        return self.heights if self.heights == "text.txt" else (self.heights,)

    def surface(self, folder):
        assert self.heights != "A050_odd.txt"
        heights = np.loadtxt(folder / self.heights, ndmin=1)
        if (heights <= 0).any():
            raise UsageError(f"a height is {heights.min():g}; heights are above 0")
        mesh = icosphere(4)
        faces = mesh.faces.copy()
        faces[0] = faces[0, ::-1] if self.open else faces[0]
        return TriangleMesh(heights[0] * mesh.vertices, faces)
"""


@needs_plugins("authoring")
@pytest.mark.slow
def test_a_subject_of_a_plug_in_is_placed_keyed_by_its_files_and_refused_at_its_place(marbling):
    (marbling.folder / "marbling.py").write_text(
        MARBLING.replace("looks=LOOKS", 'looks=LOOKS, subjects={"stone": "marbling_parts:Stone"}')
    )
    (marbling.folder / "marbling_parts.py").write_text(PARTS + STONE)
    shots = marbling.folder / "shots"

    def write(shot: str, settings: str, height: str = "0.5") -> None:
        (shots / f"{shot}.txt").write_text(height)
        subject = f"{{marbling.stone: {{heights: {settings}}}, scale: 3}}"
        (shots / f"{shot}.yaml").write_text(INKED.replace("{solid: box}", subject))

    write("A010_ink", "A010_ink.txt")
    write("A020_low", "A020_low.txt", height="-1")
    write("A030_open", "A030_open.txt, open: true")
    write("A040_lost", "no.txt")
    write("A050_odd", "A050_odd.txt")
    write("A060_text", "text.txt")
    (shots / "A070_empty.yaml").write_text(INKED.replace("{solid: box}", "{marbling.stone: , scale: 3}"))
    done = marbling.run("--json", "validate")
    told = done.stdout + done.stderr
    assert "shots/A020_low.yaml:3:11: " in told and "a height is -1; heights are above 0" in told
    assert "shots/A030_open.yaml:3:11: " in told and "Traceback" not in told
    assert "shots/A040_lost.yaml:" in told and "file no.txt is not there" in told
    line = 1 + (PARTS + STONE).partition("assert")[0].count("\n")
    assert f"AssertionError ({marbling.folder / 'marbling_parts.py'}:{line})" in told
    assert "Stone.files returned text; write return ('text.txt',)" in told
    assert "marbling.stone is empty. Write {marbling.stone: {}} for its defaults." in told
    facts = json.loads(done.stdout)[0]["first_frame"]
    assert facts["extent"] == pytest.approx(3.0, rel=0.01) and facts["subject"].startswith("marbling.stone")
    plans = []
    for height in ("0.5", "0.6", "0.5"):
        (shots / "A010_ink.txt").write_text(height)
        plans.append(json.loads(marbling.run("--json", "--dry-run", "simulate", "A010_ink").stdout)["jobs"])
    assert plans[0] == plans[2] != plans[1]
    (marbling.folder / "marbling_parts.py").write_text(PARTS + STONE.replace("Stone(SubjectKind)", "Stone"))
    left_out = "neither a SubjectKind nor a CopyLayout nor a PointsKind nor a MovingKind; write class Stone("
    assert left_out in marbling.run("validate").stderr


SCANNER = """\
from flowsculpt.api import FileFormat, Plugin
FORMATS = {"tri": FileFormat("triangles:TRIANGLES"), "odd": FileFormat("triangles:read_triangles")}
PLUGIN = Plugin("scanner", "1", formats=FORMATS)
"""


@needs_plugins("interchange")
def test_a_model_of_a_format_of_the_docs_is_read_by_every_command(environment):
    page = (Path(__file__).parents[1] / "docs" / "plugins.md").read_text(encoding="utf-8")
    (code,) = [code for code in re.findall(r"```python\n(.*?)```", page, re.DOTALL) if "TRIANGLES" in code]
    environment.install("scanner", SCANNER)
    (environment.folder / "triangles.py").write_text(code)
    corners = "0 0 0  0 1 0  1 0 0\n0 0 0  1 0 0  0 0 1\n0 0 0  0 0 1  0 1 0\n1 0 0  0 1 0  0 0 1\n"
    for name, content in (("a.tri", corners), ("cut.tri", corners[:-3]), ("a.odd", corners)):
        (environment.folder / name).write_text(content)
    done = environment.run("resample", "a.tri", "b.ply", "--max-edge-length", "0.5")
    assert done.returncode == 0, done.stderr
    assert b"element vertex" in (environment.folder / "b.ply").read_bytes()
    cut = environment.run("resample", "cut.tri", "c.ply", "--max-edge-length", "0.5")
    assert cut.returncode == 2 and cut.stderr.startswith("cut.tri: ") and cut.stderr.count("\n") == 1
    odd = environment.run("resample", "a.odd", "c.ply", "--max-edge-length", "0.5")
    said = "triangles:read_triangles, which a plug-in names as a reader, is not a SurfaceReader"
    assert odd.returncode == 4 and said in odd.stderr and "Traceback" not in odd.stderr


def plugin(name: str = "greeter", rest: str = "") -> str:
    return f"from flowsculpt.pipeline.plugin import Command, Plugin\nPLUGIN = Plugin({name!r}, '1'{rest})\n"


UNUSABLE = [
    ("broken", "import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
    ("later", plugin("later", f", api={API + 1}"), f"it is built for version {API + 1} of the API"),
    ("named", plugin("my-plug.in"), "its name 'my-plug.in' is not a letter followed by"),
    (
        "past",
        plugin("past", ", api=0"),
        "version 0 of the API, and this flowsculpt takes 1 to 2; in",
    ),
    (
        "former",
        plugin("former", ", stages={}, api=1"),
        'its field stages is gone since version 2 of the API; write entries={"NAME": ShotEntry(',
    ),
    ("lines", "one = 1\nraise ValueError('one\\ntwo')", "ValueError: one two ("),
    ("placed", "one = 1\nraise ValueError('one')", "placed.py:2)"),
    (
        "eager",
        "from flowsculpt.api import Plugin\n"
        "from flowsculpt.api.shots import read_shot\n"
        "PLUGIN = Plugin('eager', '1')",
        "eager imports what itself needs the plug-ins, such as read_shot; import that in the functions",
    ),
    ("wider", plugin("wider", ", lenses={}"), "Plugin has no field lenses; correct it, or update flowsc"),
    ("newer", "from flowsculpt.api import Lens", "; a later flowsculpt may have it"),
    ("moved", "from flowsculpt.api import read_shot", "; it is in flowsculpt.api.shots ("),
    ("common", "from flowsculpt.api.meshes import icosphere", "; it is in flowsculpt ("),
    ("older", "from pipeline.api import Plugin", "since flowsculpt 0.2.0 it is flowsculpt.pipeline"),
    ("number", plugin("number", ", api='1'"), "its field api is not a whole number"),
    (
        "nameless",
        "from flowsculpt.api import Plugin\nPLUGIN = Plugin(3, '1')",
        "its field name is not text",
    ),
    (
        "hasty",
        plugin("hasty", ", entries={'mist': 'hasty:Mist'}"),
        "its field entries is not a dict of names and ShotEntry objects",
    ),
    (
        "scant",
        "from flowsculpt.api import Plugin, ShotEntry\n"
        "PLUGIN = Plugin('scant', '1', entries={'mist': ShotEntry('scant:Mist', 'scant:add_mist')})",
        "its field entries is not a dict of names and ShotEntry objects",
    ),
    (
        "curt",
        plugin("curt", ", commands={'wave': 'curt:wave'}"),
        "its field commands is not a dict of names and Command objects",
    ),
    (
        "worded",
        plugin("worded", ", commands={'export': Command('', '')}"),
        "its command 'export' is not a",
    ),
    (
        "row",
        plugin("row", ", flows=['row:Ring']"),
        'its field flows is not a dict of names and "module:name"',
    ),
    ("comma", plugin("comma", ", observer=('comma:Watch',)"), "its field observer is not text"),
    (
        "called",
        plugin("called", ", commands={'wave': Command(print, '')}"),
        "its field commands is not a dict of names and Command objects",
    ),
    ("wordless", "raise ValueError", "ValueError ("),
    ("mute_error", "class E(Exception):\n    __str__ = None\nraise E", "E: its text cannot be written ("),
    ("leaving", "raise SystemExit('bye')", "SystemExit: bye ("),
    ("closing", "raise GeneratorExit", "GeneratorExit ("),
    ("keys", "raise KeyboardInterrupt", "KeyboardInterrupt ("),
    ("endless", "def f():\n    f()\nf()", "RecursionError: maximum recursion depth exceeded"),
    ("none", "PLUGIN = 3", "none:PLUGIN is not a flowsculpt.pipeline.plugin.Plugin"),
    (
        "twin",
        plugin("greeter"),
        "packages greeter and twin both have a plug-in greeter; uninstall one of the two",
    ),
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
]
"""Plug-ins that cannot be used: the name of the package, the text of its module, and the message."""


@pytest.fixture(scope="module")
def told_of_unusable(tmp_path_factory):
    """The lines about the plug-ins of UNUSABLE, which are installed beside one that works."""
    environment = Environment(tmp_path_factory.mktemp("unusable"))
    environment.install("greeter", GREETER)
    for name, text, _ in UNUSABLE:
        environment.install(name, text)
    done = environment.run("greet", "A010")
    assert done.returncode == 0 and done.stdout == "Hello A010\n"
    told = done.stderr.splitlines()
    assert len(told) == len(UNUSABLE), done.stderr
    return told


@pytest.mark.parametrize(("name", "fault"), [(name, fault) for name, _, fault in UNUSABLE])
def test_a_plug_in_that_cannot_be_used_is_told_in_a_line_and_the_others_work(told_of_unusable, name, fault):
    (line,) = [line for line in told_of_unusable if f"({name}:PLUGIN) is left out: " in line]
    assert line.startswith("plug-in ") and fault in line


def test_a_name_of_a_plug_in_that_is_not_there_says_which_one_it_needs():
    twin = "plug-in swell (b:PLUGIN) is left out: packages a and b both have a plug-in swell"
    of_another_package = Plugins({"swell": Plugin("swell", "1", flows={"rise": "a:Rise"})}, (twin,))
    for found, name, says in (
        (Plugins({}), "swell.breathe", "It needs plug-in swell, which is not installed (pip install …)."),
        (of_another_package, "swell.breathe", "which did not load; see the warning"),
        (of_another_package, "swell.rise", "Plug-in swell could not load it."),
    ):
        assert says in str(found.lacking(name))
    assert Plugins(of_another_package.loaded).lacking("swell.breathe") is None, "did-you-mean follows"
    assert Plugins({}).lacking("vortex") is None


@pytest.mark.parametrize(
    ("name", "needed"),
    [
        ("become", "become"),
        ("contact", "contact"),
        ("wind", "fields"),
        ("cloud", "points"),
        ("layout", "layout"),
        ("polyhedra", "polyhedra"),
        ("people.person", "people"),
        (".obj", "interchange"),
        ("flowsculpt review", "review"),
        ("flowsculpt export usd", "interchange"),
        ("--store", "remote"),
    ],
)
def test_what_a_plug_in_of_flowsculpt_adds_says_which_one_it_needs_where_that_is_missing(name, needed):
    sentence = (
        f"It needs plug-in {needed}, which is not installed (it comes with flowsculpt: install that again)."
    )
    assert Plugins({}).lacking(name) == sentence
    assert Plugins({needed: Plugin(needed, "1", flows={"person": "a:P"})}).lacking(name) != sentence


def test_the_digest_of_the_code_covers_all_files_of_plug_ins_and_goes_by_nothing_else(tmp_path, monkeypatch):
    package = tmp_path / "tabled"
    (package / "__pycache__").mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "table.csv").write_text("1")
    monkeypatch.syspath_prepend(tmp_path)

    def code(version="1"):
        return Plugins({"tabled": Plugin("tabled", version, flows={"a": "tabled:A"})}).code

    first = code()
    (package / "__pycache__" / "a.pyc").write_text("compiled")
    assert code() == first != code("2")
    (package / "table.csv").write_text("2")
    assert len({first, code(), Plugins({}).code}) == 3


def test_the_list_of_what_the_plug_ins_of_flowsculpt_add_is_complete():
    listed = tomllib.loads((ROOT / "pipeline/plugins/added.toml").read_text())
    for plugin in plugins():
        if plugin.name != "flowsculpt" and not plugin.files:
            doors = (plugin.flows, plugin.looks, plugin.subjects, plugin.encodes, plugin.entries)
            added = {f"flowsculpt {words}" for words in plugin.commands} | {
                f".{each}" for each in plugin.formats
            }
            added |= {*plugin.resamplers} | {name for door in doors for name in door if name == plugin.name}
            added |= {*plugin.flows, *(NAMED.keys() & plugin.subjects)}
            added |= {"--store"} if plugin.remote_stores else set()
            added |= {word for word, kind in NAMED.items() if f".plugins.{plugin.name}." in kind.__module__}
            assert set(listed[plugin.name]) == added, plugin.name


@needs_plugins("maintenance")
def test_an_installation_older_than_the_code_is_told_with_its_remedy(environment):
    info = environment.folder / "flowsculpt-0.0.9.dist-info"  # comes before the one that is installed
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: flowsculpt\nVersion: 0.0.9\n")
    code = f"import flowsculpt.render, sys; sys.path.insert(0, {str(environment.folder)!r})\n"
    code += "from flowsculpt.__main__ import main; main()"
    done = subprocess.run([sys.executable, "-c", code, "status"], capture_output=True, text=True)
    assert done.returncode == 4 and "install it again: make setup" in done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_the_version_is_printed_without_importing_a_plug_in(environment):
    environment.install("broken", "raise SystemExit('imported')")
    done = environment.run("--version")
    assert done.returncode == 0 and done.stdout.startswith("flowsculpt ") and not done.stderr


@pytest.mark.parametrize(
    ("wrong", "fault"),
    [
        ("1 / 0", "ZeroDivisionError: division by zero"),
        ("open('nothing')", "FileNotFoundError: [Errno 2] No such file or directory: 'nothing'"),
    ],
)
def test_an_error_in_a_command_of_a_plug_in_is_told_in_a_line_with_its_place(environment, wrong, fault):
    text = GREETER.replace('print("Hello", shot)', wrong)
    environment.install("greeter", text)
    done = environment.run("greet", "A010")
    line = 1 + text.partition(wrong)[0].count("\n")
    assert done.returncode == 4
    assert done.stderr.endswith(f"greeter.py:{line}: plug-in greeter: {fault}\n")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "parameter", ['out: shared_option("output") = None', 'out: str = shared_option("output")']
)
def test_an_option_of_a_command_that_has_no_type_is_refused_with_what_to_write(environment, parameter):
    text = GREETER.replace("def greet(common, shot: str)", f"def greet(common, shot: str, {parameter})")
    environment.install("greeter", f"from flowsculpt.api.options import shared_option\n{text}")
    done = environment.run("greet", "--help")
    fault = "its parameter out is an option without a type; write out: Annotated[TYPE, OPTION] = DEFAULT"
    assert (done.returncode, done.stderr) == (4, f"greeter:greet: {fault}\n")


def test_a_look_of_a_plug_in_that_is_out_of_range_is_left_out_with_its_line(marbling):
    parts = PARTS.replace("roughness=0.1", "roughness=7")
    (marbling.folder / "marbling_parts.py").write_text(parts)
    line = 1 + parts.partition("roughness=7")[0].count("\n")
    told = marbling.run("--dry-run", "simulate", "A010_ink").stderr
    assert f"(…marbling_parts.py:{line})".replace("…", f"{marbling.folder}/") in told


def test_a_command_whose_module_does_not_load_ends_with_one_line(environment):
    environment.install("broken", plugin("broken", ", commands={'mend': Command('broken_parts:mend', '')}"))
    done = environment.run("mend")
    assert done.returncode == 4 and done.stderr.count("\n") == 1
    assert "mend: its plug-in does not load: ModuleNotFoundError" in done.stderr


EXTRAS = """\
from flowsculpt.api import RunObserver, ShotExtras

class Lacking: pass
class Bell(RunObserver):
    def summary(self, common): return ""
class Notes(ShotExtras):
    notes = b"none"
class Near(RunObserver):
    def summary_(self, common, run): return ""
class Broken(RunObserver):
    def __init__(self): 1 / 0
class More(ShotExtras):
    def notes(self, root, shot, *, more=()): return b""
"""


BREACHES = [
    ("observer", "no_such:Bell", "ModuleNotFoundError: No module named 'no_such'"),
    ("observer", "extras", "ValueError: 'extras' is not \"module:name\""),
    ("extras", "extras:Gif", "AttributeError: module 'extras' has no attribute 'Gif'"),
    ("extras", "extras:__doc__", "it is a NoneType; name a class that extends ShotExtras"),
    ("extras", "extras:Lacking", "it is not a ShotExtras; write class Lacking(ShotExtras)"),
    (
        "observer",
        "extras:Bell",
        "its summary takes (common) and is called as summary(common, run); take these arguments",
    ),
    ("extras", "extras:Notes", "its notes is not a method; write def notes(root, shot)"),
    (
        "observer",
        "extras:Near",
        "it has no summary, but summary_; correct the name, or take one less alike",
    ),
    ("extras", "extras:More", None),
]
"""Parts of plug-ins that break their contract: the door, the place, and the message, if any."""

ASK_TWICE = """\
from flowsculpt.pipeline.cli.execution import RunObserver
from flowsculpt.pipeline.production.shot_extras import ShotExtras
for _ in "ab": RunObserver.of_plugins(); ShotExtras.of_plugins()
"""


@pytest.fixture(scope="module")
def told_of_breaches(tmp_path_factory):
    """The messages about plug-ins, one for each part of BREACHES."""
    environment = Environment(tmp_path_factory.mktemp("breaches"))
    for number, (door, place, _) in enumerate(BREACHES):
        environment.install(f"broken{number}", plugin(f"broken{number}", f", {door}={place!r}"))
    (environment.folder / "extras.py").write_text(EXTRAS)
    paths = {**os.environ, "PYTHONPATH": str(environment.folder)}
    done = subprocess.run([sys.executable, "-c", ASK_TWICE], env=paths, capture_output=True, text=True)
    assert done.returncode == 0
    return done.stderr.splitlines()


@pytest.mark.parametrize(
    "number", range(len(BREACHES)), ids=[f"{door}-{place}" for door, place, _ in BREACHES]
)
def test_a_part_that_breaks_its_contract_is_left_out_with_fact_and_remedy(told_of_breaches, number):
    _, place, fault = BREACHES[number]
    told = [line for line in told_of_breaches if line.startswith(f"plug-in broken{number}: ")]
    assert told == ([f"plug-in broken{number}: {place} is left out: {fault}"] if fault else [])
    assert len(told_of_breaches) == sum(fault is not None for _, _, fault in BREACHES)

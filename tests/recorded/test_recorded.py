"""Shows that earlier versions have recorded are opened and gone on with (docs/versions.md, the policy)."""

from __future__ import annotations

import json
import zipfile
from importlib.metadata import version
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import MissingInputError, ShotError
from flowsculpt.pipeline.production.stages import STAGES, forced_with
from flowsculpt.pipeline.shot import read_shot
from tests.conftest import ProjectFolder, commanded
from tests.needed_plugins import needed_by_gallery, needs_plugins
from tests.recorded.record import HERE, SHOT

RECORDED = sorted(HERE.glob("*.zip"))


@pytest.fixture(params=RECORDED, ids=lambda archive: archive.stem)
def root(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A show as a version left it, in the working folder."""
    with zipfile.ZipFile(request.param) as packed:
        packed.extractall(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_this_version_has_recorded_a_show() -> None:
    assert f"{version('flowsculpt')}.zip" in [archive.name for archive in RECORDED]
    assert all(archive.stat().st_size <= 200_000 for archive in RECORDED)


@needs_plugins(*needed_by_gallery())
def test_every_shot_of_the_gallery_of_then_is_read(root: Path) -> None:
    shots = sorted((root / "gallery/shots").glob("[A-Z]*.yaml"))
    assert len(shots) > 20
    for path in shots:
        try:
            assert read_shot(path).frames, path
        except (MissingInputError, ShotError) as error:  # models, pictures and sounds are not recorded
            assert all("is not there" in line for line in str(error).splitlines()), error


@needs_plugins("maintenance", "review", "versions")
def test_files_notes_and_versions_of_then_are_whole_and_listed(root: Path) -> None:
    from flowsculpt.pipeline.plugins.versions.provenance import Provenance

    assert commanded(root, "--dry-run", "verify") == (0, "Every file is what it should be.\n")
    code, notes = commanded(root, "--json", "notes", SHOT)
    assert code == 0 and "More light from the left" in notes and "approved" in notes
    code, versions = commanded(root, "--json", "versions")
    (published,) = json.loads(versions)
    assert code == 0 and (published["version"], published["note"]) == ("v001", "recorded")
    code, report = commanded(root, "report")
    assert code == 0 and "denoising" in report

    record = Provenance.read(root / published["provenance"])
    assert list(record.frames) == [1, 2] and record.quality == "draft.scale10"
    code, planned = commanded(root, "--dry-run", "reproduce", published["provenance"])
    assert code == 0 and "rendering 2 frames" in planned


@needs_plugins("maintenance", "versions")
def test_a_run_goes_on_in_a_root_of_then(root: Path) -> None:
    from flowsculpt.pipeline.plugins.versions.provenance import Provenance

    words = (SHOT, "-q", "draft", "--scale", "10%", "--variant", "scalar_rgb")
    done = ProjectFolder(root).run("--json", "render", *words)
    assert done.code == 0, done.err
    (published,) = json.loads(commanded(root, "--json", "versions")[1])
    record = Provenance.read(root / published["provenance"])
    then = {stage.name: {name: record.packages[name] for name in stage.packages} for stage in STAGES.values()}
    newer = {name for name, number in record.stages.items() if STAGES[name].version != number}
    newer |= {stage.name for stage in STAGES.values() if not then[stage.name].items() <= stage.recipe.items()}
    assert set(json.loads(done.out)["made"]) <= forced_with(newer), "other files are found"
    code, states = commanded(root, "--json", "status", SHOT)
    assert code == 0 and all(not row["missing"] for row in json.loads(states)), states

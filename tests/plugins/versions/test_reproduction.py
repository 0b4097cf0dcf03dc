"""Versions are made again from their provenance alone, and what keeps them from it is told."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.errors import MachineError, MissingInputError, UsageError
from flowsculpt.pipeline.plugins.versions.provenance import FILE, Provenance
from flowsculpt.pipeline.production.planning.profile import avoid
from flowsculpt.pipeline.production.stages import FINISH
from flowsculpt.render.post.image import read_exr, write_exr
from tests.plugins.versions.desk import MODEL, NAME, Desk, done

SMALL = ("-q", "draft", "--scale", "10%")


def test_a_version_is_made_again_from_its_provenance_alone_to_the_last_bit(desk: Desk) -> None:
    """One frame needs its neighbours too, for temporal denoising."""
    desk.shot.write_text("title: another shot by now\n")
    shutil.rmtree(desk.root / ".flowsculpt")
    one = desk.repetition("2")
    assert one.request.requested == (1, 2, 3) and one.notes == []
    source = str(desk.home / "v001" / FILE)
    done(one.home, one.plan())
    assert [(each.what, each.same) for each in one.comparisons()] == [("frame 2", True)]
    again = desk.repetition()
    done(again.home, again.plan())
    code, said = desk.command("reproduce", source)
    assert code == 0 and "frames 1-4 and the movie identical" in said
    assert one.home == desk.root / "renders" / "repeated" / f"{NAME}.v001"
    changed = again.request.keys.pictures(again.store)
    assert changed is not None
    file = again.store.path("frame", changed[3].frame)
    layers, header = read_exr(file)
    layers["beauty"][0, 0, 0] += 0.5
    file.unlink()
    write_exr(file, layers, header)
    code, said = desk.command("reproduce", source)
    assert code == 1 and "frame 3: differs in 0.08% of its pixels, by up to 0.5" in said
    facts = json.loads(desk.command("--json", "reproduce", source)[1])
    assert list(facts["different"]) == ["frame 3"] and facts["identical"] == [
        "frame 1",
        "frame 2",
        "frame 4",
        "movie",
    ]


def test_what_is_otherwise_than_it_was_is_told_before(desk: Desk) -> None:
    again = desk.repetition()
    record = replace(
        again.record,
        packages={**again.record.packages, "mitsuba": "3.0"},
        stages={**again.record.stages, "finish": 0},
        host={**again.record.host, "processor": "an abacus"},
    )
    other = "scalar_rgb" if record.variant != "scalar_rgb" else "llvm_ad_rgb"
    told = "\n".join(record.differences(other))
    assert f"{other} renders now, {record.variant} did then" in told
    assert "mitsuba is" in told and "was 3.0" in told
    assert f"stage finish has version {FINISH.version} now and had 0" in told and "was an abacus" in told


def test_a_variant_that_crashed_is_not_replaced_behind_the_users_back(desk: Desk) -> None:
    again = desk.repetition()
    avoid(again.home, NAME, again.record.variant, f"{again.record.variant} crashed (SIGABRT)")
    with pytest.raises(MachineError, match=r"crashed \(SIGABRT\); --variant renders v001 with another var"):
        again.plan()


def test_a_file_that_it_reads_must_be_what_it_was(desk: Desk) -> None:
    model = desk.root / "models" / "wedge.obj"
    model.unlink()
    with pytest.raises(MissingInputError, match=r"wedge.obj: missing, and T010_tiny v001 was made"):
        desk.repetition().plan()
    model.write_text(MODEL.replace("v 2 0 0", "v 3 0 0"))
    code, said = desk.command("reproduce", str(desk.home / "v001" / FILE))
    assert code == 2 and "wedge.obj: changed since T010_tiny v001 was made" in said
    assert said.count("\n") <= 1


def test_versions_of_before_stages_had_versions_are_read(tmp_path: Path, published: Desk) -> None:
    data = json.loads((published.home / "v001" / FILE).read_text())
    source = data.pop("source")
    data |= {"format": 1, "script": {**source, "pins": source["inputs"]}, "code": {"finish": "0123"}}
    del data["stages"], data["script"]["inputs"]
    (tmp_path / FILE).write_text(json.dumps(data))
    record = Provenance.read(tmp_path / FILE)
    assert record == replace(Provenance.read(published.home / "v001" / FILE), stages={})
    told = "\n".join(record.differences(record.variant))
    assert f"stage finish has version {FINISH.version} now and had unknown" in told


def test_a_provenance_gives_no_leave_to_run_code(desk: Desk) -> None:
    source = desk.home / "v001" / FILE
    data = json.loads(source.read_text())
    data["source"]["allow_code"] = True
    source.unlink()
    source.write_text(json.dumps(data))
    assert desk.repetition().request.source.allow_code is False
    assert desk.repetition(allow_code=True).request.source.allow_code is True


@pytest.mark.parametrize(
    "change",
    [
        "",
        "[]",
        '{"format": 1}',
        {"shot": "../elsewhere"},
        {"version": "../v001"},
        {"quality": "finest"},
        {"frames": {}},
        {"frames": {"1": {}}},
        {"movie": {}},
        {"packages": []},
        {"format": 3},
        {"source": None},
    ],
)
def test_what_is_no_provenance_is_told_in_one_line(
    tmp_path: Path, published: Desk, change: str | dict
) -> None:
    data = json.loads((published.home / "v001" / FILE).read_text())
    source = Desk(tmp_path).home / "v001" / FILE
    source.parent.mkdir(parents=True)
    source.write_text(change if isinstance(change, str) else json.dumps({**data, **change}))
    with pytest.raises(UsageError, match="not the provenance of a published version"):
        Provenance.read(source)
    code, said = Desk(tmp_path).command("versions")
    assert code == 2 and "not the provenance" in said


@pytest.mark.soak
def test_a_version_is_rendered_published_edited_away_and_made_again(project: Any) -> None:
    assert project.run("render", NAME, *SMALL).code == 0
    assert project.run("publish", NAME, *SMALL, "--note", "so it was").code == 0
    project.shot.write_text(project.shot.read_text().replace("azimuth: -30", "azimuth: 40"))
    assert project.run("publish", NAME, *SMALL).code == 2
    before = sorted(path.name for path in (project.path / "renders" / NAME).rglob("*"))
    again = project.run("--json", "reproduce", f"renders/published/{NAME}/v001/provenance.json")
    assert again.code == 0, again.err
    assert json.loads(again.out)["identical"] == [*(f"frame {n}" for n in range(1, 7)), "movie"]
    assert sorted(path.name for path in (project.path / "renders" / NAME).rglob("*")) == before
    assert project.run("render", NAME, *SMALL).code == 0
    assert project.run("publish", NAME, *SMALL).code == 0
    assert [fact["version"] for fact in json.loads(project.run("--json", "versions").out)] == ["v001", "v002"]

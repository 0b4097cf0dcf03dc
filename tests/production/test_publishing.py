"""Versions: frozen whole, never overwritten, and made again from what stands beside them."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from pipeline.errors import FrameError, MachineError, MissingInputError, UsageError
from pipeline.production.execution.project import Project
from pipeline.production.planning.plan import Plan
from pipeline.production.request.variants import avoid
from pipeline.production.stages import FINISH
from pipeline.production.store.locks import exclusive
from pipeline.production.tasks.job import Context
from pipeline.production.tasks.worker import task_of
from pipeline.production.versions import publish
from pipeline.production.versions.provenance import FILE, Provenance, pixels_of
from pipeline.production.versions.publish import Release
from pipeline.production.versions.reproduce import Reproduction
from pipeline.production.versions.review_notes import read_notes
from render.base.input_files import digest_of_file
from render.post.image import read_exr, write_exr
from tests.conftest import commanded
from tests.dailies.review.note_cases import TIMES, document, note

NAME = "T010_tiny"
QUALITY = "draft.scale10"
SHOT = """\
title: A wedge, twisted
frames: 1-4
subject: {model: ../models/wedge.obj}
resample: {max_edge_length: 0.9}
flows:
  - twist: {axis: y, amount: {ease: linear, keys: {1: 0, 4: 40}}}
quality: {draft: {samples: 2, auxiliary_samples: 2, denoise: fast, temporal_denoise: 1}}
"""
MODEL = "v 0 0 0\nv 2 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
RENDER = f"flowsculpt render {NAME} -q draft --scale 10%"


@dataclass(frozen=True)
class Desk:
    """A working folder, whose jobs are done one by one in this process."""

    root: Path

    @property
    def shot(self) -> Path:
        return self.root / "shots" / f"{NAME}.yaml"

    @property
    def home(self) -> Path:
        return self.root / "renders" / "published" / NAME

    def release(self, note: str = "", version: str | None = None) -> Release:
        project = Project(self.root, 1)
        return Release(project.request(self.shot, QUALITY), project.store, RENDER, note, version)

    def render(self) -> None:
        done(self.root, Project(self.root, 1).pictures([NAME], QUALITY))

    def repetition(self, frames: str | None = None, **others: str) -> Reproduction:
        source = self.home / "v001" / FILE
        return Reproduction(Provenance.read(source), source, Project(self.root, 1, **others), frames)

    def command(self, *words: str) -> tuple[int, str]:
        """Exit code and words of a command."""
        return commanded(self.root, *words)


def done(root: Path, plan: Plan) -> None:
    for job in plan.jobs:
        assert task_of(job.stage)(Context.of(root, plan, job.name))


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Desk]:
    """A shot rendered and published as v001; tests work on copies of it."""
    root = tmp_path_factory.mktemp("published")
    for file, text in ((f"shots/{NAME}.yaml", SHOT), ("models/wedge.obj", MODEL)):
        (root / file).parent.mkdir()
        (root / file).write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(root)
        desk = Desk(root)
        with pytest.raises(MissingInputError) as refused:
            desk.release().publish()
        assert f"frames 1-4 missing. What is published is made from the shot file of today; {RENDER}" in str(
            refused.value
        )
        desk.render()
        first = desk.release("first look").publish()
        assert (first.version, first.before) == ("v001", False)
    yield desk


@pytest.fixture
def desk(published: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Desk:
    root = tmp_path / "studio"
    shutil.copytree(published.root, root, copy_function=os.link)
    for file in (root / "shots").iterdir():  # these are edited in place
        text = file.read_text()
        file.unlink()
        file.write_text(text)
    monkeypatch.chdir(root)
    return Desk(root)


def test_a_version_is_read_only_and_tells_all_that_it_was_made_from(published: Desk) -> None:
    folder = published.home / "v001"
    record = Provenance.read(folder / FILE)
    assert (record.note, record.quality, list(record.frames)) == ("first look", QUALITY, [1, 2, 3, 4])
    assert record.source.text == SHOT and record.source.path == Path(f"shots/{NAME}.yaml")
    assert record.source.inputs == (
        ("models/wedge.obj", digest_of_file(published.root / "models/wedge.obj")),
    )
    assert set(record.packages) >= {"mitsuba", "numba", "flowsculpt"} and record.host["cores"] >= 1
    assert record.timings["render"] > 0.0 and record.timings["simulate"] > 0.0
    for frame in record.frames.values():
        file = folder / frame.file
        assert (digest_of_file(file), pixels_of(file)) == (frame.sha256, frame.pixels)
        assert frame.seconds and len({frame.mesh, frame.normals, frame.raw, frame.frame}) == 4
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert len(files) == 4 + 2 and all(path.stat().st_mode & 0o222 == 0 for path in files)
    assert Provenance.from_data(json.loads(json.dumps(record.as_data()))) == record


def test_the_same_content_is_published_once(desk: Desk) -> None:
    desk.shot.write_text("# the same picture\n" + SHOT)
    for asked in (None, "v001", "v007"):
        again = desk.release("once more", asked).publish()
        assert (again.version, again.before) == ("v001", True)
    assert [place.name for place in desk.home.iterdir()] == ["v001"]
    code, said = desk.command("publish", NAME, "-q", "draft", "--scale", "10%")
    assert code == 0 and "already published as v001" in said


def test_what_was_edited_since_is_stale_until_it_is_rendered_and_then_the_next_version(desk: Desk) -> None:
    before = {path: path.read_bytes() for path in desk.home.rglob("*") if path.is_file()}
    desk.shot.write_text(SHOT.replace("4: 40", "4: 60"))
    code, said = desk.command("publish", NAME, "-q", "draft", "--scale", "10%")
    assert code == 2 and "frames 1-4 stale: made from an earlier shot file or with --set" in said
    assert said.endswith(f"{RENDER} makes it.")
    kept = desk.shot.read_text()
    short = SHOT.replace("frames: 1-4", "frames: 1-1").replace("{ease: linear, keys: {1: 0, 4: 40}}", "40")
    desk.shot.write_text(f"{short.rstrip()}\nstage: plinth\n")
    assert "draft.scale10: frame 1 stale" in desk.command("publish", NAME, "-q", "draft", "--scale", "10%")[1]
    desk.shot.write_text(kept)
    desk.render()
    with pytest.raises(UsageError, match=r"v001 is published already, with other frames.*the next is v002"):
        desk.release(version="v001").publish()
    with pytest.raises(UsageError, match="--version 2 is no version; write it as v002"):
        desk.release(version="2").publish()
    assert not desk.release().publish(dry=True).before and not (desk.home / "v002").exists()
    assert desk.release().publish().version == "v002"
    assert all(path.read_bytes() == content for path, content in before.items())
    code, said = desk.command("versions", NAME, "--json")
    assert [(fact["version"], fact["note"]) for fact in json.loads(said)] == [
        ("v001", "first look"),
        ("v002", ""),
    ]


def test_a_frame_that_cannot_be_read_is_forgotten_and_not_published(desk: Desk) -> None:
    desk.shot.write_text(SHOT.replace("4: 40", "4: 50"))
    desk.render()
    request = desk.release().request
    keys = request.picture_keys(desk.release().store)
    assert keys is not None
    stored = desk.release().store.path("frame", keys[3].frame)
    stored.chmod(0o644)
    os.truncate(stored, 500)
    with pytest.raises(FrameError, match=f"frame 3 is damaged.*{RENDER} makes it again"):
        desk.release().publish()
    assert not stored.exists() and [place.name for place in desk.home.iterdir()] == ["v001"]


def test_a_version_is_there_whole_or_not_at_all(desk: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.rmtree(desk.home / "v001")
    (desk.home / ".draft.v001.killed").mkdir()

    def full(source: Path, place: Path) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(publish, "_link", full)
        with pytest.raises(MachineError, match="the disk is full"):
            desk.release().publish()
    assert list(desk.home.iterdir()) == []
    with exclusive(desk.root), pytest.raises(MachineError, match="another flowsculpt run"):
        desk.release().publish()
    monkeypatch.setattr(publish.os, "link", full)  # a file system without links
    assert desk.release().publish().folder.is_dir()
    assert desk.repetition().record.frames[1].sha256 == digest_of_file(
        desk.home / f"v001/frames/{NAME}.0001.exr"
    )


def test_a_version_shares_its_bytes_with_the_store_unless_copies_are_asked_for(desk: Desk) -> None:
    record = desk.repetition().record.frames[2]
    stored = desk.release().store.path("frame", record.frame)
    frozen = desk.home / "v001" / record.file
    assert frozen.samefile(stored)
    shutil.rmtree(desk.home / "v001")
    code, said = desk.command("publish", NAME, "-q", "draft", "--scale", "10%", "--copy")
    assert code == 0, said
    assert not frozen.samefile(stored) and digest_of_file(frozen) == record.sha256
    assert all(path.stat().st_mode & 0o222 == 0 for path in frozen.parents[1].rglob("*.*"))


def rewritten(path: Path, content: bytes) -> None:
    """In its place, for what tests work on are links."""
    path.unlink()
    path.write_bytes(content)


def test_verify_tells_what_of_a_version_is_not_what_was_published_and_mends_nothing(desk: Desk) -> None:
    assert desk.command("verify") == (0, "Every file is what it should be.\n")
    frames = desk.home / "v001" / "frames"
    second, third = frames / f"{NAME}.0002.exr", frames / f"{NAME}.0003.exr"
    damaged = bytes([*second.read_bytes()[:-1], 0])
    rewritten(second, damaged)
    third.unlink()
    code, said = desk.command("verify")
    assert code == 1
    assert f"frames/{NAME}.0002.exr: is not what was published: damaged, or altered since" in said
    assert f"frames/{NAME}.0003.exr: is gone, and was published" in said
    assert f"flowsculpt render --from {desk.home / 'v001' / FILE} -f 2-3 makes it again" in said
    assert "2 files of published versions are not what was published." in said
    assert second.read_bytes() == damaged and not third.exists()
    (frames.parent / f"{NAME}.mp4").unlink()
    facts = json.loads("{" + desk.command("--json", "verify")[1].partition("{")[2])
    assert [fact["frame"] for fact in facts["published"]] == [2, 3, None] and not facts["faulty"]
    assert f"--from {desk.home / 'v001' / FILE} makes it again" in desk.command("--dry-run", "verify")[1]


def test_a_version_keeps_the_notes_that_its_shot_had(desk: Desk) -> None:
    (desk.root / "ann.json").write_text(json.dumps(document(note(shot=NAME))))
    assert desk.command("notes", NAME, "--add", "ann.json")[0] == 0
    shutil.rmtree(desk.home / "v001")
    frozen = desk.release().publish().folder / "notes.json"
    assert [each.text for each in read_notes(frozen)] == ["softer"]
    (desk.root / "ben.json").write_text(json.dumps(document(note(shot=NAME, text="no", modified=TIMES[3]))))
    assert desk.command("notes", NAME, "--add", "ben.json")[0] == 0
    assert [each.text for each in read_notes(frozen)] == ["softer"], "what is published stays as it was"
    assert desk.command("verify")[0] == 0
    frozen.chmod(0o644)
    frozen.write_text("{}")
    code, said = desk.command("verify")
    assert code == 1 and "v001/notes.json: is not what was published" in said
    assert "restore its notes from a backup" in desk.command("--dry-run", "verify")[1]


def test_verify_tells_of_a_version_whose_provenance_is_lost(desk: Desk) -> None:
    rewritten(desk.home / "v001" / FILE, b"{}")
    code, said = desk.command("verify")
    assert code == 1 and "provenance.json: is not what was written: damaged, or altered since" in said
    assert "tells what it was made from; restore that from a backup" in said


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
    code, said = desk.command("render", "--from", source)
    assert code == 0 and "frames 1-4 and the movie identical" in said
    assert one.home == desk.root / "renders" / "repeated" / f"{NAME}.v001"
    changed = again.request.picture_keys(again.store)
    assert changed is not None
    file = again.store.path("frame", changed[3].frame)
    layers, header = read_exr(file)
    layers["beauty"][0, 0, 0] += 0.5
    file.unlink()
    write_exr(file, layers, header)
    code, said = desk.command("render", "--from", source)
    assert code == 1 and "frame 3: differs in 0.08% of its pixels, by up to 0.5" in said
    facts = json.loads(desk.command("--json", "render", "--from", source)[1])
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
    with pytest.raises(MachineError, match=r"crashed \(SIGABRT\); --variant renders v001 with another,"):
        again.plan()


def test_a_file_that_it_reads_must_be_what_it_was(desk: Desk) -> None:
    model = desk.root / "models" / "wedge.obj"
    model.unlink()
    with pytest.raises(MissingInputError, match=r"wedge.obj: gone, and T010_tiny v001 was made"):
        desk.repetition().plan()
    model.write_text(MODEL.replace("v 2 0 0", "v 3 0 0"))
    code, said = desk.command("render", "--from", str(desk.home / "v001" / FILE))
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
    with pytest.raises(UsageError, match="this is no provenance of a published version"):
        Provenance.read(source)
    code, said = Desk(tmp_path).command("versions")
    assert code == 2 and "this is no provenance" in said


HOOK = "import json, sys; json.dump(json.load(sys.stdin), open('told.json', 'w')); print('of the hook')"


def published_with(hook: str) -> tuple[str, ...]:
    return ("publish", NAME, "-q", "draft", "--scale", "10%", "--hook", hook)


def test_a_hook_is_told_the_provenance_and_the_folder_of_a_version(desk: Desk) -> None:
    code, said = desk.command("--json", *published_with(shlex.join([sys.executable, "-c", HOOK])))
    assert code == 0 and json.loads(said)["version"] == "v001"
    told = json.loads((desk.root / "told.json").read_text())
    folder = Path(told["folder"])
    assert told["event"] == "published" and told["published_before"] and folder == desk.home / "v001"
    assert Provenance.from_data(told["provenance"]) == Provenance.read(folder / FILE)


def test_a_hook_that_fails_is_named_and_the_version_stays(desk: Desk) -> None:
    desk.shot.write_text(SHOT.replace("40}}}", "50}}}"))
    desk.render()
    failing = shlex.join([sys.executable, "-c", "raise SystemExit(3)"])
    code, said = desk.command(*published_with(failing))
    assert code == 4 and "it ended with 3. v002 is published all the same" in said
    assert (desk.home / "v002" / FILE).is_file()


@pytest.mark.parametrize(
    ("hook", "code", "told"),
    [
        ("no-such-program --now", 3, "there is no program no-such-program"),
        ("'unclosed", 2, "No closing quotation"),
        ("", 2, "--hook is empty"),
    ],
)
def test_a_hook_that_cannot_run_is_told_before_anything_is_published(
    desk: Desk, hook: str, code: int, told: str
) -> None:
    shutil.rmtree(desk.home)
    ended, said = desk.command(*published_with(hook))
    assert ended == code and told in said and not desk.home.exists()


@pytest.mark.parametrize(
    ("words", "code", "told"),
    [
        (("versions", "B999"), 3, f"B999 is not published in .*; published are {NAME}"),
        (("render",), 2, "render needs the name of a shot, or --from"),
        (("render", "--from", "nowhere.json"), 3, "nowhere.json: no such provenance"),
        (("render", NAME, "--from", "nowhere.json"), 2, "the provenance says shot, quality"),
        (
            ("render", "--from", f"renders/published/{NAME}/v001/{FILE}", "-f", "9"),
            2,
            "frames 9 are not in v001",
        ),
    ],
)
def test_mistakes_are_told_in_one_line(desk: Desk, words: tuple[str, ...], code: int, told: str) -> None:
    ended, said = desk.command(*words)
    assert ended == code and re.search(told, said) and said.count("\n") <= 1

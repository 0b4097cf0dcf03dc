"""Versions: frozen whole, never overwritten, checked by verify, and told to hooks."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import FrameError, MachineError, UsageError
from flowsculpt.pipeline.plugins.versions import publishing
from flowsculpt.pipeline.plugins.versions.provenance import FILE, Provenance
from flowsculpt.pipeline.plugins.versions.reproduction import pixels_of
from flowsculpt.pipeline.production.store.locks import Locks
from flowsculpt.render.base.input_files import InputFile
from tests.needed_plugins import needs_plugins
from tests.plugins.review.note_cases import TIMES, document, note
from tests.plugins.versions.desk import NAME, QUALITY, RENDER, SHOT, Desk, rewritten


def test_a_version_is_read_only_and_tells_all_that_it_was_made_from(published: Desk) -> None:
    folder = published.home / "v001"
    record = Provenance.read(folder / FILE)
    assert (record.note, record.quality, list(record.frames)) == ("first look", QUALITY, [1, 2, 3, 4])
    assert record.source.text == SHOT and record.source.path == Path(f"shots/{NAME}.yaml")
    assert record.source.inputs == (
        ("models/wedge.obj", InputFile(published.root / "models/wedge.obj").digest()),
    )
    assert set(record.packages) >= {"mitsuba", "numba", "flowsculpt"} and record.host["cores"] >= 1
    assert record.timings["render"] > 0.0 and record.timings["simulate"] > 0.0
    for frame in record.frames.values():
        file = folder / frame.file
        assert (InputFile(file).digest(), pixels_of(file)) == (frame.sha256, frame.pixels)
        assert frame.seconds and len({frame.mesh, frame.normals, frame.raw, frame.frame}) == 4
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert len(files) == 4 + 2 and all(path.stat().st_mode & 0o222 == 0 for path in files)
    assert Provenance.from_data(json.loads(json.dumps(record.as_data()))) == record
    for file in ("../../x.mp4", "/tmp/x.mp4"):  # of somebody else: a patch would copy its frames there
        with pytest.raises(ValueError):
            Provenance.from_data(record.as_data() | {"movie": {**record.movie, "file": file}})


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
    with pytest.raises(UsageError, match=r"v001 is already published with other frames.*the next is v002"):
        desk.release(version="v001").publish()
    with pytest.raises(UsageError, match="--version 2 is not a version; write v002"):
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
    keys = request.keys.pictures(desk.release().store)
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
        patch.setattr(publishing, "_link", full)
        with pytest.raises(MachineError, match="the disk is full"):
            desk.release().publish()
    assert list(desk.home.iterdir()) == []
    with Locks(desk.root).hold_alone(), pytest.raises(MachineError, match="another flowsculpt run"):
        desk.release().publish()
    monkeypatch.setattr(publishing.os, "link", full)  # a file system without links
    assert desk.release().publish().folder.is_dir()
    assert (
        desk.repetition().record.frames[1].sha256
        == InputFile(desk.home / f"v001/frames/{NAME}.0001.exr").digest()
    )


def test_a_version_shares_its_bytes_with_the_store_unless_copies_are_asked_for(desk: Desk) -> None:
    record = desk.repetition().record.frames[2]
    stored = desk.release().store.path("frame", record.frame)
    frozen = desk.home / "v001" / record.file
    assert frozen.samefile(stored)
    shutil.rmtree(desk.home / "v001")
    code, said = desk.command("publish", NAME, "-q", "draft", "--scale", "10%", "--copy")
    assert code == 0, said
    assert not frozen.samefile(stored) and InputFile(frozen).digest() == record.sha256
    assert all(path.stat().st_mode & 0o222 == 0 for path in frozen.parents[1].rglob("*.*"))


@needs_plugins("maintenance")
def test_verify_tells_what_of_a_version_is_not_what_was_published_and_mends_nothing(desk: Desk) -> None:
    assert desk.command("verify") == (0, "Every file is what it should be.\n")
    frames = desk.home / "v001" / "frames"
    second, third = frames / f"{NAME}.0002.exr", frames / f"{NAME}.0003.exr"
    damaged = bytes([*second.read_bytes()[:-1], 0])
    rewritten(second, damaged)
    third.unlink()
    code, said = desk.command("verify")
    assert code == 1
    assert f"frames/{NAME}.0002.exr: differs from the published file: damaged, or altered since" in said
    assert f"frames/{NAME}.0003.exr: is gone, and was published" in said
    assert f"flowsculpt reproduce {desk.home / 'v001' / FILE} -f 2-3 makes it again" in said
    assert "2 files of published versions are not as published." in said
    assert second.read_bytes() == damaged and not third.exists()
    (frames.parent / f"{NAME}.mp4").unlink()
    facts = json.loads("{" + desk.command("--json", "verify")[1].partition("{")[2])
    assert [fact["frame"] for fact in facts["published"]] == [2, 3, None] and not facts["faulty"]
    assert f"reproduce {desk.home / 'v001' / FILE} makes it again" in desk.command("--dry-run", "verify")[1]


@needs_plugins("review", "maintenance")
def test_a_version_keeps_the_notes_that_its_shot_had(desk: Desk) -> None:
    from flowsculpt.pipeline.plugins.review.review_notes import read_notes

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
    assert code == 1 and "v001/notes.json: differs from the published file" in said
    assert "restore its notes from a backup" in desk.command("--dry-run", "verify")[1]


@needs_plugins("maintenance")
def test_verify_tells_of_a_version_whose_provenance_is_lost(desk: Desk) -> None:
    rewritten(desk.home / "v001" / FILE, b"{}")
    code, said = desk.command("verify")
    assert code == 1 and "provenance.json: differs from what the run wrote: damaged, or altered since" in said
    assert "records what it was made from; restore that file from a backup" in said


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
    assert code == 4 and "it ended with 3. v002 is published nevertheless" in said
    assert (desk.home / "v002" / FILE).is_file()


@pytest.mark.parametrize(
    ("hook", "code", "told"),
    [
        ("no-such-program --now", 3, "program no-such-program not found"),
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
        (("versions", "B999"), 3, f"B999 is not published in .*; published: {NAME}"),
        (("reproduce", "nowhere.json"), 3, "nowhere.json: no such file"),
        (
            ("reproduce", f"renders/published/{NAME}/v001/{FILE}", "-f", "9"),
            2,
            "frames 9 are not in v001",
        ),
    ],
)
def test_mistakes_are_told_in_one_line(desk: Desk, words: tuple[str, ...], code: int, told: str) -> None:
    ended, said = desk.command(*words)
    assert ended == code and re.search(told, said) and said.count("\n") <= 1

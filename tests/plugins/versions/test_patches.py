"""A patch is a new version of an old one, with some of its frames as they are rendered today."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from flowsculpt.pipeline.errors import FrameError, MissingInputError, UsageError
from flowsculpt.pipeline.frames import FrameRange
from flowsculpt.pipeline.plugins.versions.provenance import FILE, Provenance
from flowsculpt.pipeline.plugins.versions.publishing import Patch
from flowsculpt.pipeline.plugins.versions.reproduction import Reproduction
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.render.base.input_files import InputFile
from flowsculpt.render.movie.probe import probe_movie
from tests.needed_plugins import needs_plugins
from tests.plugins.versions.desk import NAME, QUALITY, Desk, done

LOOK = "look: glaze\n"


def patch(desk: Desk, frames: str = "2-3", base: str = "v001", quality: str = QUALITY) -> Patch:
    project = Project(desk.root, 1)
    request = project.request(desk.shot, quality)
    command, numbers = f"flowsculpt render {NAME} -f {frames}", FrameRange.parse(frames)
    return Patch(request, project.store, command, base=base, frames=numbers)


def rendered(desk: Desk, frames: str = "2-3") -> None:
    """Render frames of the shot with another look."""
    desk.shot.write_text(desk.shot.read_text() + LOOK)
    done(desk.root, Project(desk.root, 1).pictures([NAME], QUALITY, FrameRange.parse(frames)))


def test_a_patch_has_the_new_frames_of_its_range_and_the_files_of_the_version_before(desk: Desk) -> None:
    rendered(desk)
    made = patch(desk).publish()
    assert (made.version, made.before) == ("v002", False)
    old, new = (Provenance.read(desk.home / version / FILE) for version in ("v001", "v002"))
    assert [n for n in old.frames if old.frames[n].sha256 != new.frames[n].sha256] == [2, 3]
    for number, frame in new.frames.items():
        assert InputFile(made.folder / frame.file).digest() == frame.sha256, number
    assert new.patch == {
        "version": "v001",
        "frames": "2-3",
        "sha256": InputFile(desk.home / "v001" / FILE).digest(),
    }
    assert LOOK in new.source.text and not old.patch
    assert probe_movie(made.folder / new.movie["file"]).frames == 4
    assert InputFile(made.folder / new.movie["file"]).digest() == new.movie["sha256"] != old.movie["sha256"]
    again = patch(desk).publish()
    assert (again.version, again.before) == ("v002", True)
    from flowsculpt.pipeline.plugins.review.review_page import Search

    shown = Search(Project(desk.root, 1), ()).shot(NAME).sequences
    notes = {each.label: each.note for each in shown if each.kind == "version"}
    assert notes[f"v002 {QUALITY}"] == "patch of v001: frames 2-3 are new"


@needs_plugins("maintenance")
def test_a_patch_is_verified_and_its_own_frames_are_made_again(desk: Desk) -> None:
    rendered(desk)
    for command in (f"publish {NAME} -q draft --scale 10% --patch v001 -f 2-3", "verify"):
        code, words = desk.command(*command.split())
        assert code == 0, words
    source = desk.home / "v002" / FILE
    record, project = Provenance.read(source), Project(desk.root, 1)
    again = Reproduction(record, source, project)
    assert again.numbers == (2, 3)
    with pytest.raises(UsageError, match="v002 has frames 4 from v001; reproduce them from the provenance"):
        Reproduction(record, source, project, FrameRange.parse("3-4")).numbers  # noqa: B018


def lost(desk: Desk) -> None:
    desk.shot.write_text(desk.shot.read_text() + LOOK)
    for frame in (desk.root / f"renders/{NAME}/{QUALITY}/frames").glob("*.exr"):
        frame.unlink()


def damaged(desk: Desk) -> None:
    rendered(desk)
    frame = desk.home / "v001" / "frames" / f"{NAME}.0001.exr"
    frame.unlink()
    frame.write_bytes(b"no frame")


def longer(desk: Desk) -> None:
    desk.shot.write_text(desk.shot.read_text().replace("frames: 1-4", "frames: 1-5"))


@pytest.mark.parametrize(
    ("before", "arguments", "error", "message"),
    [
        (
            lost,
            {},
            MissingInputError,
            r"frames 2-3 missing. .*; flowsculpt render .* -f 2-3 makes it",
        ),
        (
            damaged,
            {},
            FrameError,
            r"0001.exr is damaged or missing; see flowsculpt verify",
        ),
        (longer, {}, UsageError, "v001 has frames 1-4, and today's frames 1-5; all frames of a version"),
        (rendered, {"base": "v007"}, MissingInputError, "has no such version; published: v001"),
        (rendered, {"base": "../v1"}, UsageError, "is not a version; write it as v001"),
        (rendered, {"frames": "3-9"}, UsageError, "frames 5-9 are not in T010_tiny, which has 1-4"),
        (
            rendered,
            {"quality": "draft.scale20"},
            UsageError,
            "v001 has quality draft.scale10, and",
        ),
    ],
)
def test_what_cannot_be_patched_is_refused_in_one_message(
    before: Callable[[Desk], None],
    arguments: dict[str, str],
    error: type[Exception],
    message: str,
    desk: Desk,
) -> None:
    before(desk)
    with pytest.raises(error, match=message) as told:
        patch(desk, **arguments).publish()
    assert len(str(told.value).splitlines()) == 1
    assert [folder.name for folder in desk.home.iterdir()] == ["v001"]


def test_a_patch_names_a_version_and_its_frames(desk: Desk, tmp_path: Path) -> None:
    for words in (("--patch", "v001"), ("-f", "2-3")):
        code, told = desk.command("publish", NAME, "-q", "draft", "--scale", "10%", *words)
        assert code == 2 and "--patch and -f go together" in told

"""Maintenance: damage is found and repaired, and unused files are collected."""

from __future__ import annotations

import json
import os
import shutil
import time
from pathlib import Path
from typing import Any

import pytest

from flowsculpt.pipeline.plugins.maintenance.clean import collect_garbage
from flowsculpt.pipeline.plugins.maintenance.verify import verify
from flowsculpt.pipeline.production.execution.project import Project
from flowsculpt.pipeline.production.request.lookup import Show
from flowsculpt.pipeline.production.store.locks import Locks
from flowsculpt.pipeline.production.store.store import Store
from flowsculpt.render.post.image import read_header
from tests.conftest import QUALITY
from tests.needed_plugins import needs_plugins

NAME = "T010_tiny"


def damage(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[-len(content) // 3] ^= 0x40
    path.chmod(0o644)
    path.write_bytes(bytes(content))


def stored(project: Any, kind: str, place: Path) -> Path:
    key = read_header(place)["key"]
    return Path(project.path / ".flowsculpt/store" / kind / key[:2] / f"{key}.exr")


def test_a_flipped_bit_is_found_wherever_it_is(finished: Any) -> None:
    store = Store(finished.path)
    assert not [each for each in verify(store, 2) if each.fault]
    for kind in ("mesh", "normals", "raw", "frame"):
        victim = next(path for of, _, path in store.entries() if of == kind)
        damage(victim)
        (found,) = [each for each in verify(store, 2) if each.fault]
        assert (found.kind, found.path) == (kind, victim)
        victim.unlink()


def test_verify_makes_again_what_is_damaged_and_nothing_else(finished: Any) -> None:
    damage(stored(finished, "raw", finished.frames(kind="raw")[2]))
    damage(stored(finished, "frame", finished.frames()[2]))
    only_told = finished.call("--dry-run", "verify")
    assert only_told.code == 1 and "2 files" in only_told.out
    done = finished.run("--json", "verify")
    assert done.code == 0, done.err
    facts = json.loads(done.out)
    assert facts["healed"] and len(facts["faulty"]) == 2
    assert not [each for each in verify(Store(finished.path), 2) if each.fault]
    assert finished.call("render", NAME, "-q", QUALITY).out.startswith("Nothing to be done")


@needs_plugins("sheets")
def test_verify_makes_frames_of_a_scale_again_and_says_how_a_curve_sheet_is(finished: Any) -> None:
    finished.render("2", quality="draft.scale10")
    assert finished.call("curves", NAME).code == 0
    (frame,) = finished.frames("draft.scale10")
    whole, curves = frame.read_bytes(), finished.path / "renders" / NAME / f"{NAME}.curves.svg"
    frame.chmod(0o644)
    frame.write_bytes(b"")
    damage(curves)
    done = finished.run("verify")
    assert done.code == 1 and "2 files are damaged, and 1 not made again" in done.out
    assert f"{frame.relative_to(finished.path)}: differs from what the run wrote" in done.err
    assert f"{curves.relative_to(finished.path)}: flowsculpt curves {NAME} makes it again" in done.err
    assert frame.read_bytes() == whole
    assert finished.call("curves", NAME).code == 0
    assert finished.call("verify").out == "Every file is what it should be.\n"


def test_cleaning_keeps_what_today_and_the_last_runs_need(
    finished: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing is shown in renders/, which would keep it."""
    monkeypatch.chdir(finished.path)
    shutil.rmtree(finished.path / "renders")
    store, text = Store(finished.path), finished.shot.read_text()
    everything = {path for _, _, path in store.entries()}

    def requests() -> list[Any]:
        return [Project(finished.path, 2).request(Show().find_shot(NAME), QUALITY)]

    def gone_but_films(keep: int) -> list[Path]:
        """Return the collected files but movies, which belong to no shot."""
        return [
            p for p in collect_garbage(store, requests(), keep, dry_run=True).removed if p.suffix != ".mp4"
        ]

    assert not gone_but_films(0)
    finished.shot.write_text(text.replace("6: 60}", "6: 90}"))
    assert not gone_but_films(2)
    gone = collect_garbage(store, requests(), 0, dry_run=True)
    meshes = [path for path in gone.removed if "/mesh/" in str(path)]
    assert len(meshes) == 2 and gone.freed > 0 and {p for _, _, p in store.entries()} == everything
    collect_garbage(store, requests(), 0, dry_run=False)
    assert {p for _, _, p in store.entries()} == everything - set(gone.removed)


@needs_plugins("become", "breed")
def test_cleaning_deletes_trials_of_breed_and_fits_that_were_not_used_for_long(
    project: Any, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory
) -> None:
    from flowsculpt.pipeline.plugins.become.stored_fits import path_of

    monkeypatch.chdir(project.path)
    fits = tmp_path_factory.mktemp("cache") / "fits"
    fits.mkdir()
    monkeypatch.setattr("flowsculpt.render.base.user_cache.writable_cache", lambda: fits.parent)
    monkeypatch.setattr("flowsculpt.render.base.user_cache.readable_cache", lambda: fits.parent)
    text = project.shot.read_text()
    project.shot.write_text(text.replace("flows:", "flows:\n  - become: {solid: icosphere, detail: coarse}"))
    requests = [Project(project.path, 2).request(Show().find_shot(NAME), QUALITY)]
    flow = requests[0].shot.motion.flow.flows[0].flow
    ours = path_of(flow.start, flow.target, flow.detail)
    old, unfinished, new = (fits / f"{name}.npz" for name in ("old", "b.unfinished", "new"))
    trial = project.path / ".flowsculpt/breeding/abc/001.npz"
    picture = project.path / "bred/.breeding-abc/pictures/001.png"
    for folder in (trial.parent, picture.parent):
        folder.mkdir(parents=True)
    for file in (ours, old, unfinished, new, trial, picture):
        file.write_bytes(bytes(100))
    for file in (ours, old, unfinished):
        os.utime(file, (0.0, time.time() - 31 * 86400))

    store, others = Store(project.path), {"fits of become": (2, 200), "trials of breed": (2, 200)}
    assert collect_garbage(store, requests, 2, dry_run=True).others == others and trial.exists()
    assert collect_garbage(store, requests, 2, dry_run=False).others == others
    assert sorted(fits.iterdir()) == sorted([ours, new])
    assert not trial.parent.exists() and not (project.path / "bred").exists()
    assert not collect_garbage(store, requests, 2, dry_run=False).others

    trial.parent.mkdir(parents=True)
    trial.write_bytes(bytes(100))
    told = project.call("--dry-run", "clean")
    assert told.code == 0 and "Would free 100 bytes in 1 file: trials of breed." in told.out, told.err
    with Locks(project.path).hold_with_writers():  # as breed does
        assert project.call("clean").code == 4 and trial.exists()
    assert project.call("clean").code == 0 and not trial.exists()


def test_status_tells_done_stale_and_missing(finished):
    finished.render("1-3", quality="draft")
    rows = {row["what"]: row for row in json.loads(finished.call("--json", "status").out)}
    assert rows["draft"]["done"] == [1, 2, 3] and rows["draft"]["missing"] == [4, 5, 6]
    finished.frames("draft")[0].unlink()
    finished.shot.write_text(finished.shot.read_text().replace("azimuth: -30", "azimuth: 5"))
    rows = {row["what"]: row for row in json.loads(finished.call("--json", "status").out)}
    assert rows["meshes"]["done"] == [1, 2, 3, 4, 5, 6]
    assert rows["draft"]["missing"] == [1, 4, 5, 6]
    assert rows["draft"]["stale"] == [2, 3]


def test_a_shot_that_goes_wrong_on_the_way_does_not_hide_the_others(project):
    """Its speed is not a number between two half frames."""
    (project.shot.parent / "T020_wrong.yaml").write_text(
        "frames: 1-6\ntitle: Wrong\nresample: off\nsubject: {solid: box, size: [1, 1, 1]}\n"
        "flows: [vortex: {strength: 1}]\n"
        'speed: {formula: "1 + sqrt(abs(t - 0.03) - 0.002)"}\n'
    )
    done = project.call("--json", "status")
    assert done.code == 2 and "T020_wrong.yaml:6:1: speed is not finite: formula" in done.err
    assert [row["shot"] for row in json.loads(done.out)] == [NAME]

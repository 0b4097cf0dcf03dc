"""Whole runs with a remote store: roots on disks of their own make each frame once, together."""

from __future__ import annotations

import hashlib
import json
import shutil
import uuid

import pytest

from flowsculpt.pipeline.production.store.remote_store import READ_ONLY, VARIABLE
from flowsculpt.pipeline.production.store.store import missed_uploads
from tests.conftest import QUALITY, commanded
from tests.needed_plugins import needs_plugins
from tests.plugins.remote.s3 import BUCKET
from tests.production.snakemake import snakemake

THREE = ("render", "T010_tiny", "-f", "1-3", "--scale", "10%")


@pytest.fixture
def roots(project, s3, monkeypatch):
    """Two working folders with one shot, an S3 store that both are told of, and its address."""
    other = project.copy(project.path.with_name("other"))
    url = f"s3://{BUCKET}/{uuid.uuid4().hex}"
    monkeypatch.setenv(VARIABLE, url)
    yield project, other, url
    shutil.rmtree(other.path, ignore_errors=True)


def pictures(project):
    """The digests of finished frames and movies, by their paths."""
    home = project.path / "renders"
    files = [*home.glob("**/frames/*.exr"), *home.glob("**/*.mp4")]
    return {f.relative_to(home): hashlib.sha256(f.read_bytes()).hexdigest() for f in files}


@needs_plugins("maintenance")
def test_a_film_that_is_pushed_is_made_nowhere_again(project, finished, s3):
    url = f"s3://{BUCKET}/{uuid.uuid4().hex}"
    pushed = finished.run("push", "--store", url, "--json")
    assert pushed.code == 0, pushed.err
    assert json.loads(pushed.out)["uploaded"] > 20
    again = project.run("film", "-q", QUALITY, "--store", url, "--json")
    assert again.code == 0, again.err
    facts = json.loads(again.out)
    assert facts["made"] == {} and facts["runs"] == []
    assert pictures(project) == pictures(finished)
    rows = json.loads(project.run("status", "T010_tiny", "--store", url, "--json").out)
    assert [row["remote"] for row in rows if row["what"] == "meshes"] == [[1, 2, 3, 4, 5, 6]]
    assert project.call("render", "T010_tiny", "-q", QUALITY).out.startswith("Nothing to be done")


@needs_plugins("maintenance")
def test_commands_tell_what_is_wrong_with_the_remote_store(tmp_path, s3, monkeypatch):
    monkeypatch.setenv(VARIABLE, "")  # which commands set, and pytest sets back
    monkeypatch.setenv(READ_ONLY, "")
    code, said = commanded(tmp_path, "push")
    assert code == 2 and "no remote store is set; name one with --store" in said
    code, said = commanded(tmp_path, "push", "--store", "s3://nowhere/show", "--store-read-only")
    monkeypatch.setenv(READ_ONLY, "")
    assert code == 2 and "s3://nowhere/show may only be read here" in said
    code, said = commanded(tmp_path, "push", "--store", "s3://nowhere/show")
    assert code == 4 and said.startswith("s3://nowhere/show: no such bucket or folder")
    code, said = commanded(tmp_path, "status", "--store", "s4://bucket")
    assert code == 2 and "s4:// is not known" in said


@pytest.mark.soak
def test_snakemake_alone_takes_what_the_remote_store_has(project, finished, s3, monkeypatch):
    monkeypatch.setenv(VARIABLE, f"s3://{BUCKET}/{uuid.uuid4().hex}")
    assert finished.run("push").code == 0
    done = snakemake(project.path, "--config", f"quality={QUALITY}")
    assert done.returncode == 0, done.stdout
    assert "Nothing to be done" in done.stdout
    assert pictures(project) == pictures(finished)


@pytest.mark.soak
def test_what_one_root_rendered_another_shows_to_the_bit_and_renders_nothing(roots, s3):
    ours, theirs, _ = roots
    done = ours.run(*THREE)
    assert done.code == 0, done.err
    assert len(pictures(ours)) == 4
    asked = json.loads(theirs.run(*THREE, "--dry-run", "--json").out)
    assert asked["jobs"] == [] and asked["fetched"] == 4  # frames and movie; cameras came for the plan
    again = theirs.run(*THREE, "--json")
    assert again.code == 0, again.err
    facts = json.loads(again.out)
    assert facts["made"] == {} and facts["fetched"] == 4
    assert pictures(theirs) == pictures(ours)
    assert not any(secret in again.err + done.err for secret in ("AKIA", "a-secret"))


@pytest.mark.soak
def test_a_bucket_that_is_missing_fails_no_run_and_the_next_one_uploads(roots, s3, monkeypatch):
    ours, theirs, url = roots
    monkeypatch.setenv(VARIABLE, "s3://nowhere/show")
    done = ours.run("simulate", "T010_tiny")
    assert done.code == 0
    assert done.err.count("no such bucket") == 1 and "the next run uploads them" in done.err
    assert len(missed_uploads(ours.path)) == 6
    assert "no such bucket" in ours.run("doctor").out
    monkeypatch.setenv(VARIABLE, url)
    assert ours.run("simulate", "T010_tiny").code == 0
    assert missed_uploads(ours.path) == []
    assert json.loads(theirs.run("simulate", "T010_tiny", "--json").out)["made"] == {}


@pytest.mark.soak
def test_a_film_of_two_workers_on_their_own_disks_has_the_bits_of_a_local_one(
    roots, s3, finished_project, monkeypatch
):
    ours, theirs, _ = roots
    for worker, frames in ((ours, "1-3"), (theirs, "4-6")):
        done = worker.run("render", "T010_tiny", "-f", frames, "-q", QUALITY)
        assert done.code == 0, done.err
    done = theirs.run("film", "-q", QUALITY, "--json")
    assert done.code == 0, done.err
    assert json.loads(done.out)["made"].get("render", 0) == 0
    local = pictures(finished_project)
    assert {path: digest for path, digest in pictures(theirs).items() if path in local} == local


@needs_plugins("maintenance")
@pytest.mark.soak
def test_verify_repairs_from_the_remote_store_without_making_anything_again(roots, s3):
    ours, _, _ = roots
    assert ours.run(*THREE).code == 0
    before = pictures(ours)
    frame = next((ours.path / "renders").glob("**/frames/*.0002.exr"))
    frame.chmod(0o644)
    whole = frame.read_bytes()
    frame.write_bytes(whole[:-9] + b"?" + whole[-8:])
    events = ours.path / ".flowsculpt" / "events"
    known = set(events.iterdir())
    done = ours.run("verify", "--set", "frames=1-6")
    assert done.code == 0, done.err
    assert pictures(ours) == before
    assert set(events.iterdir()) == known, "no job ran"


@pytest.mark.soak
def test_a_server_that_goes_away_in_the_middle_of_a_run_costs_seconds_and_no_frame(roots, s3):
    ours, theirs, _ = roots
    assert ours.run("simulate", "T010_tiny").code == 0
    running = theirs.start(*THREE)
    theirs.wait_until(lambda: list((theirs.path / ".flowsculpt").glob("store/normals/*/*")))
    s3.fault = "refuse"
    _, said = running.communicate()
    assert running.returncode == 0, said
    assert said.count("continuing without it") == 1
    assert missed_uploads(theirs.path)
    s3.fault = None
    assert theirs.run(*THREE).code == 0
    assert missed_uploads(theirs.path) == []
    assert json.loads(ours.run(*THREE, "--json").out)["made"] == {}

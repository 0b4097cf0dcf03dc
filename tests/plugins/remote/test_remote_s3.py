"""The remote store on an S3 server that is slow, refuses, cuts answers short, alters them, or is away."""

import logging
import threading
import time
import uuid

import pytest

from flowsculpt.pipeline.plugins.remote import remote_files, remote_requests
from flowsculpt.pipeline.plugins.remote.remote_files import RemoteFiles
from flowsculpt.pipeline.production.store.store import Store, missed_uploads
from tests.plugins.remote.s3 import BUCKET, CREDENTIALS, Proxy

KEYS = [f"{number:032x}" for number in range(40)]
CONTENT = b"light\n" * 30000


@pytest.fixture(autouse=True)
def quick(monkeypatch, s3: Proxy):
    """Listings are made anew each time, and tries follow each other quickly."""
    monkeypatch.setattr(remote_files, "LISTED_SECONDS", -1.0)
    monkeypatch.setattr(remote_requests, "PATIENCE", 1.0)
    monkeypatch.setattr(remote_requests, "FIRST_PAUSE", 0.05)
    monkeypatch.setattr(remote_requests, "CONNECT_SECONDS", 120.0)
    monkeypatch.setattr(remote_requests, "READ_SECONDS", 120.0)
    remote_files._opened.cache_clear()


@pytest.fixture
def stores(tmp_path):
    url = f"s3://{BUCKET}/{uuid.uuid4().hex}"
    return Store(tmp_path / "a", url), Store(tmp_path / "b", url)


def fill(store, key=KEYS[0]):
    return store.put("png", key, lambda path: path.write_bytes(b"\x89PNG\r\n\x1a\n" + key.encode() + CONTENT))


def is_right(store, key=KEYS[0]):
    return store.path("png", key).read_bytes() == b"\x89PNG\r\n\x1a\n" + key.encode() + CONTENT


def warnings(caplog):
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def test_what_one_root_put_another_fetches_to_the_bit(stores):
    ours, theirs = stores
    assert not theirs.holds("png", KEYS[0])
    fill(ours)
    assert theirs.bring("png", KEYS[0]) and is_right(theirs)
    assert theirs.remote.fault() is None


def test_many_keys_are_asked_for_in_few_requests_side_by_side(stores, s3: Proxy, monkeypatch):
    ours, theirs = stores
    keys = [f"{number * 2654435761 % 2**32:08x}" * 4 for number in range(60)]
    monkeypatch.setattr(remote_files, "LISTED_SECONDS", 60.0)
    for key in keys:
        fill(ours, key)
    remote_files._opened.cache_clear()
    assert theirs.remote.fault() is None  # connects
    s3.expect(together=5)
    assert all(theirs.holds("png", key) for key in keys)
    assert len(s3.requests) <= 1 + 16
    assert s3.most_at_once >= 5
    s3.expect(together=5)
    assert theirs.bring_all([("png", key) for key in keys]) == 60
    assert all(is_right(theirs, key) for key in keys)
    assert s3.most_at_once >= 5


@pytest.mark.parametrize("fault", ["refuse", "error", "hang"])
def test_a_server_that_fails_for_long_fails_nobody_and_is_told_once(
    stores, s3: Proxy, caplog, fault, monkeypatch
):
    ours, theirs = stores
    with monkeypatch.context() as patch:
        if fault == "hang":
            patch.setattr(remote_requests, "READ_SECONDS", 1.0)
            patch.setattr(remote_requests, "PATIENCE", 60.0)
        assert ours.remote.fault() is None
    s3.fault = fault
    asked = []
    for key in KEYS[:5]:
        fill(ours, key)
        assert is_right(ours, key) and not ours.holds("png", KEYS[9])
        asked.append(len(s3.requests))
    assert len(set(asked)) == 1, "it is left alone after the first"
    (said,) = warnings(caplog)
    assert "continuing without it" in said and "the next run uploads them" in said
    assert not any(secret in said for secret in CREDENTIALS.values() if secret != "us-east-1")
    assert len(missed_uploads(ours.root)) == 5
    s3.fault = None
    remote_files._opened.cache_clear()  # as in the next run
    assert ours.upload_missed() == (5, 0)
    assert theirs.bring("png", KEYS[4]) and is_right(theirs, KEYS[4])


def test_a_server_that_is_away_for_a_moment_is_asked_again(stores, s3: Proxy, caplog, monkeypatch):
    monkeypatch.setattr(remote_requests, "PATIENCE", 60.0)
    ours, theirs = stores
    assert ours.remote.fault() is None
    s3.fault = "error"
    threading.Timer(0.4, lambda: setattr(s3, "fault", None)).start()
    fill(ours)
    assert warnings(caplog) == [] and missed_uploads(ours.root) == []
    assert theirs.bring("png", KEYS[0])


def test_a_server_that_comes_back_is_used_again_in_the_same_process(stores, s3: Proxy, monkeypatch):
    ours, _ = stores
    assert ours.remote.fault() is None
    monkeypatch.setattr(remote_requests, "SILENT_SECONDS", 0.3)
    ours.remote.requests._silence = 0.3
    s3.fault = "refuse"
    fill(ours)
    s3.fault = None
    time.sleep(0.35)
    fill(ours, KEYS[1])
    assert missed_uploads(ours.root) == [("png", KEYS[0])]


@pytest.mark.parametrize("fault", ["cut", "alter"])
def test_what_is_damaged_on_the_way_is_never_used(stores, s3: Proxy, caplog, fault):
    ours, theirs = stores
    fill(ours)
    s3.fault = fault
    assert not theirs.bring("png", KEYS[0])
    assert not theirs.path("png", KEYS[0]).exists() and not list(theirs.inner_scratch.iterdir())
    assert len(warnings(caplog)) == 1
    fill(theirs)
    s3.fault = None
    remote_files._opened.cache_clear()
    assert theirs.upload_missed().unsent == 0
    theirs.discard("png", KEYS[0])
    assert theirs.bring("png", KEYS[0]) and is_right(theirs)


def test_an_object_that_is_removed_after_it_was_listed_is_made_again(stores, monkeypatch, caplog):
    ours, theirs = stores
    fill(ours)
    monkeypatch.setattr(remote_files, "LISTED_SECONDS", 60.0)
    assert theirs.holds("png", KEYS[0])
    theirs.remote.requests.files.rm(theirs.remote.home, recursive=True)
    assert not theirs.bring("png", KEYS[0]) and not theirs.holds("png", KEYS[0])
    assert fill(theirs) and warnings(caplog) == []


def test_a_bucket_that_is_not_there_is_told_by_its_name(tmp_path, caplog):
    store = Store(tmp_path, "s3://nowhere/show")
    fill(store)
    (said,) = warnings(caplog)
    assert said.startswith("s3://nowhere/show: no such bucket or folder")
    assert "no such bucket" in RemoteFiles.of("s3://nowhere/show").fault()


def test_without_credentials_the_message_says_so(stores, monkeypatch, caplog, tmp_path):
    for name in CREDENTIALS:
        monkeypatch.delenv(name)
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "none"))
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "none"))
    ours, _ = stores
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    fill(ours)
    (said,) = warnings(caplog)
    assert "credentials" in said

"""The remote store on a file share: what one root made, another one fetches, to the bit."""

import json
import logging
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flowsculpt.pipeline.errors import FrameError, MachineError, UsageError
from flowsculpt.pipeline.plugins.remote import remote_files, remote_requests
from flowsculpt.pipeline.plugins.remote.push_command import lacking_names
from flowsculpt.pipeline.plugins.remote.remote_files import RemoteFiles
from flowsculpt.pipeline.production.store.readers import with_key, write_npz
from flowsculpt.pipeline.production.store.remote_store import READ_ONLY, VARIABLE
from flowsculpt.pipeline.production.store.store import Store, missed_uploads
from flowsculpt.render.post.image import write_exr
from flowsculpt.render.scene.aovs import RenderedFrame

KEY = "ab" * 16
OTHER = "cd" * 16


@pytest.fixture(autouse=True)
def nothing_is_remembered(monkeypatch):
    """Listings are made anew each time, and nothing is known of an earlier test's remote store."""
    monkeypatch.setattr(remote_files, "LISTED_SECONDS", -1.0)
    monkeypatch.setattr(remote_requests, "PATIENCE", 0.2)
    monkeypatch.setattr(remote_requests, "FIRST_PAUSE", 0.05)
    remote_files._opened.cache_clear()


@pytest.fixture
def share(tmp_path):
    (tmp_path / "share").mkdir()
    return tmp_path / "share"


@pytest.fixture
def url(share):
    return f"file://{share}"


@pytest.fixture
def stores(tmp_path, url):
    return Store(tmp_path / "a", url), Store(tmp_path / "b", url)


def content_of(key):
    """The content of a key's file: the same whoever makes it."""
    return json.dumps({"made from": [key] * 5000}).encode()


def fill(store, key=KEY):
    return store.put("cameras", key, lambda path: path.write_bytes(content_of(key)))


def never(path: Path) -> None:
    raise AssertionError(f"{path} is made again")


def sent(share):
    return sorted(path for path in share.rglob("*.json") if path.is_file())


def warnings(caplog):
    return [record.getMessage() for record in caplog.records if record.levelno >= logging.WARNING]


def test_what_one_root_made_another_does_not_make_again(stores):
    ours, theirs = stores
    fill(ours)
    assert theirs.holds("cameras", KEY)
    assert theirs.is_remote("cameras", KEY)
    path = theirs.put("cameras", KEY, never)
    assert path.read_bytes() == content_of(KEY)
    assert not path.stat().st_mode & 0o222
    assert theirs.digests.check(path)
    assert not theirs.is_remote("cameras", KEY)


def test_reading_and_linking_fetch_what_only_the_remote_store_has(stores):
    ours, theirs = stores
    fill(ours), fill(ours, OTHER)
    assert theirs.read("cameras", KEY, Path("a.json"), Path.read_bytes) == content_of(KEY)
    theirs.link("cameras", OTHER, Path("renders/a.json"))
    assert (theirs.root / "renders/a.json").read_bytes() == content_of(OTHER)


def test_nothing_is_fetched_to_answer_whether_it_is_held(stores):
    ours, theirs = stores
    fill(ours)
    assert theirs.holds("cameras", KEY) and not theirs.holds("cameras", OTHER)
    assert not list(theirs.root.rglob("*.json"))


def test_a_remote_store_that_may_only_be_read_gives_and_takes_nothing(stores, share, monkeypatch):
    ours, theirs = stores
    fill(ours)
    monkeypatch.setenv(READ_ONLY, "1")
    assert theirs.bring("cameras", KEY)
    assert fill(theirs, OTHER).read_bytes() == content_of(OTHER)
    assert theirs.upload_missed() == (0, 0)
    assert not missed_uploads(theirs.root)
    assert len(sent(share)) == 1
    sent(share)[0].write_bytes(b"foreign")
    theirs.discard("cameras", KEY)
    assert len(sent(share)) == 1  # even what is damaged stays


def test_without_a_remote_store_nothing_leaves_the_root(tmp_path, share):
    store = Store(tmp_path / "a", url=None)
    fill(store)
    assert sent(share) == [] and missed_uploads(store.root) == []


@pytest.mark.parametrize(
    "damage", [lambda b: b[:-7], lambda b: b"", lambda b: b[:9] + b"?" + b[10:]], ids=["cut", "empty", "bit"]
)
def test_a_damaged_object_is_told_once_never_used_and_replaced(stores, share, caplog, damage):
    ours, theirs = stores
    fill(ours)
    (there,) = sent(share)
    whole = there.read_bytes()
    there.write_bytes(damage(whole))
    assert not theirs.bring("cameras", KEY)
    assert not theirs.holds("cameras", KEY) and not theirs.bring("cameras", KEY)
    assert not theirs.path("cameras", KEY).exists() and not list(theirs.inner_scratch.iterdir())
    (said,) = warnings(caplog)
    assert "differs from the stored file" in said and KEY in said
    assert fill(theirs).read_bytes() == content_of(KEY)
    assert there.read_bytes() == whole
    assert theirs.holds("cameras", KEY)


def test_a_damaged_local_file_is_healed_from_the_remote_store(stores):
    ours, _ = stores
    path = fill(ours)
    ours.link("cameras", KEY, Path("shown.json"))
    path.chmod(0o644)
    path.write_bytes(b"damaged")
    assert ours.read("cameras", KEY, Path("shown.json"), Path.read_bytes) == content_of(KEY)
    assert (ours.root / "shown.json").read_bytes() == content_of(KEY)


def test_a_file_that_cannot_be_read_though_it_is_what_was_sent_leaves_the_remote_store(stores, share):
    ours, _ = stores
    fill(ours)

    def refuse(path: Path) -> None:
        raise remote_error

    from flowsculpt.pipeline.production.store.digests import CorruptFileError

    remote_error = CorruptFileError("not a camera")
    with pytest.raises(FrameError, match="run again to make it again"):
        ours.read("cameras", KEY, Path("a.json"), refuse)
    assert sent(share) == [] and not ours.holds("cameras", KEY)


def test_making_again_by_force_replaces_what_is_there(stores, share):
    ours, theirs = stores
    fill(ours)
    theirs.put("cameras", KEY, lambda path: path.write_bytes(b'"newer"'), replace=True)
    (there,) = sent(share)
    assert there.read_bytes() == b'"newer"'


def test_a_share_that_is_not_mounted_is_told_once_and_filled_later(stores, share, caplog):
    ours, theirs = stores
    share.rmdir()
    fill(ours), fill(ours, OTHER)
    assert not share.exists(), "a folder made here would hide the share once it is mounted"
    (said,) = warnings(caplog)
    assert "no such bucket or folder" in said and "continuing without it" in said
    assert missed_uploads(ours.root) == [("cameras", KEY), ("cameras", OTHER)]
    share.mkdir()
    remote_files._opened.cache_clear()
    assert ours.upload_missed() == (2, 0)
    assert missed_uploads(ours.root) == []
    assert theirs.bring("cameras", KEY) and theirs.bring("cameras", OTHER)


def test_a_full_share_fails_no_one_and_is_told_once(stores, share, caplog, monkeypatch):
    from fsspec.implementations.local import LocalFileSystem

    def refuse(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    ours, _ = stores
    with monkeypatch.context() as full:
        full.setattr(LocalFileSystem, "put_file", refuse)
        fill(ours), fill(ours, OTHER)
    (said,) = warnings(caplog)
    assert "it is full" in said
    assert sent(share) == [] and not list((share / "tmp").iterdir())


def test_a_full_disk_here_is_no_fault_of_the_remote_store(stores, monkeypatch, caplog):
    from fsspec.implementations.local import LocalFileSystem

    def refuse(*_: object, **__: object) -> None:
        raise OSError(28, "No space left on device")

    ours, theirs = stores
    fill(ours)
    monkeypatch.setattr(LocalFileSystem, "get_file", refuse)
    with pytest.raises(MachineError, match="the disk is full"):
        theirs.bring("cameras", KEY)
    assert warnings(caplog) == []


def test_a_writer_that_is_killed_leaves_a_mark_and_the_next_run_uploads(stores, share, monkeypatch):
    ours, _ = stores
    with monkeypatch.context() as killed:
        killed.setattr(RemoteFiles, "_put", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
        with pytest.raises(KeyboardInterrupt):
            fill(ours)
    assert missed_uploads(ours.root) == [("cameras", KEY)]
    assert ours.upload_missed() == (1, 0) and len(sent(share)) == 1


def test_a_marked_file_that_is_gone_or_damaged_meanwhile_is_not_sent(stores, share):
    ours, _ = stores
    share.rmdir()
    fill(ours).unlink()
    damaged = fill(ours, OTHER)
    damaged.chmod(0o644)
    damaged.write_bytes(b"damaged")
    share.mkdir()
    remote_files._opened.cache_clear()
    assert ours.upload_missed() == (0, 0)
    assert missed_uploads(ours.root) == [] and sent(share) == []


def test_files_made_before_there_was_a_remote_store_are_uploaded_on_demand(tmp_path, url, share):
    before = Store(tmp_path / "a", url=None)
    fill(before), fill(before, OTHER)
    ours = Store(tmp_path / "a", url)
    ours.upload_missed()
    assert sent(share) == []
    assert len(lacking_names(ours)) == 2
    assert ours.upload_missed(lacking_names(ours)) == (2, 0)
    assert lacking_names(ours) == [] and len(sent(share)) == 2


def test_other_files_in_the_folder_are_let_be(stores, share):
    ours, theirs = stores
    (share / "cameras" / "a").mkdir(parents=True)
    for name in ("readme.txt", f"{KEY}.json", f".{KEY}.{OTHER}.json", f"{KEY}.short.json"):
        (share / "cameras" / "a" / name).write_text("somebody's")
    assert not theirs.holds("cameras", KEY)
    fill(ours)
    assert theirs.bring("cameras", KEY)


def test_the_environment_names_the_remote_store_to_every_process(monkeypatch, tmp_path, url):
    monkeypatch.setenv(VARIABLE, url)
    assert Store(tmp_path).url == url
    monkeypatch.setenv(VARIABLE, "")
    assert Store(tmp_path).remote is None


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("s4://bucket/show", "s4:// is not known. There are: s3"),
        ("s3://", "a bucket or folder must follow"),
        ("sftp://me:secret@host/show", "it contains a password"),
        ("s3://[x", "cannot be parsed"),
        ("sftp://host:port/show", "cannot be parsed"),
        ("s3://my bucket/show", "'my bucket' cannot name a bucket"),
        ("s3://server:9000/bucket", "AWS_ENDPOINT_URL"),
        ("s3:/bucket/show", "has :// after its scheme"),
        ("s3://bucket\n/show", "control characters"),
        ("  ", "is empty"),
        ("~nobody-of-this-name/show", "home"),
        ("file://host/show", "an absolute path must follow"),
    ],
)
def test_an_address_that_cannot_be_one_is_told_in_one_line(given, said):
    with pytest.raises(UsageError, match=said) as raised:
        remote_requests.checked_url(given)
    assert "secret" not in str(raised.value) and "\n" not in str(raised.value)


def test_a_package_that_is_missing_is_named_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setattr(remote_requests, "find_spec", lambda module: None)
    with pytest.raises(MachineError, match=r"needs the package s3fs.*pip install s3fs"):
        remote_requests.checked_url("s3://bucket/show")


def test_a_folder_is_an_address_from_wherever_jobs_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert remote_requests.checked_url("my share") == f"file://{tmp_path}/my share"


KEYS = [f"{number:x}" * 32 for number in range(4)]
ACTIONS = ["put", "holds", "bring", "evict", "cut", "alter", "delete", "upload"]


@pytest.mark.slow
@given(
    steps=st.lists(st.tuples(st.sampled_from(ACTIONS), st.integers(0, 1), st.sampled_from(KEYS)), max_size=25)
)
@settings(max_examples=60, deadline=None)
def test_two_roots_that_share_a_remote_store_never_read_other_bytes(tmp_path_factory, steps):
    home = tmp_path_factory.mktemp("roots")
    (home / "share").mkdir()
    remote_files._opened.cache_clear()
    stores = [Store(home / name, f"file://{home}/share") for name in "ab"]
    undamaged: set[str] = set()
    for action, which, key in steps:
        store = stores[which]
        there = [path for path in sent(home / "share") if path.name.startswith(key)]
        if action == "put":
            was_here = store.is_here("cameras", key)
            assert fill(store, key).read_bytes() == content_of(key)
            undamaged |= set() if was_here else {key}
        elif action == "holds":
            assert store.holds("cameras", key) or key not in undamaged
        elif action == "bring":
            came = store.bring("cameras", key)
            assert came or key not in undamaged
            assert not came or store.path("cameras", key).read_bytes() == content_of(key)
        elif action == "evict":
            store.discard("cameras", key)
        elif action == "upload":
            store.upload_missed(lacking_names(store))
        elif there:
            undamaged.discard(key)
            if action == "delete":
                there[0].unlink()
            else:
                whole = there[0].read_bytes()
                there[0].write_bytes(whole[:-1] if action == "cut" else whole[:-1] + b"?")


@pytest.mark.parametrize(
    ("kind", "content"),
    [
        ("cameras", b"no JSON"),
        ("raw", b"no picture"),
        ("mesh", b"PK no arrays"),
        ("movie", b"#!/bin/sh of some length"),
        ("png", b"<svg/> of some length"),
        ("gif", b"\x89PNG\r\n\x1a\n of some length"),
    ],
)
def test_what_was_sent_under_a_right_digest_and_is_nothing_of_its_kind_is_not_used(
    stores, caplog, kind, content
):
    ours, theirs = stores
    ours.put(kind, KEY, lambda path: path.write_bytes(content))
    assert theirs.holds(kind, KEY) and not theirs.bring(kind, KEY)
    assert not theirs.path(kind, KEY).exists() and not theirs.holds(kind, KEY)
    (said,) = warnings(caplog)
    assert KEY in said and "it is not used" in said


@pytest.mark.parametrize(
    ("kind", "content"),
    [
        ("movie", b"\0\0\0 ftypisom"),
        ("mov", b"\0\0\0\x14ftypqt  "),
        ("mkv", b"\x1a\x45\xdf\xa3"),
        ("webp", b"RIFF\0\0\0\0WEBPVP8X"),
        ("avif", b"\0\0\0 ftypavis"),
        ("gif", b"GIF89a\x10\0\x10\0"),
        ("png", b"\x89PNG\r\n\x1a\n"),
        ("png16", b"\x89PNG\r\n\x1a\n"),
        ("jpeg", b"\xff\xd8\xff\xe0"),
        ("measures", b"{}"),
        ("statistics", b"{}"),
        ("cameras", b"{}"),
    ],
)
def test_files_that_begin_as_their_kind_does_are_used(stores, kind, content):
    ours, theirs = stores
    ours.put(kind, KEY, lambda path: path.write_bytes(content))
    assert theirs.bring(kind, KEY)


ARRAYS = {
    "vertices": np.zeros((3, 3), np.float32),
    "normals": np.ones((3, 3), np.float32),
    "material": np.zeros((3, 3), np.float32),
    "faces": np.array([[0, 1, 2]], np.int32),
    "source_vertex": np.arange(3, dtype=np.int32),
}


@pytest.mark.parametrize(
    ("kind", "content"),
    [
        *(("cameras", text) for text in (b"[]", b"null", b'{"1": []}', b'{"1": {"camera": 3}}', b"[" * 9999)),
        *(("measures", text) for text in (b"[]", b"3")),
        ("mesh", ARRAYS),
        ("mesh", {"vertices": ARRAYS["vertices"]}),
        *(("normals", {name: v for name, v in ARRAYS.items() if name != left_out}) for left_out in ARRAYS),
        ("normals", {**ARRAYS, "faces": np.array([[0, 1, 9]], np.int32)}),
        ("normals", {**ARRAYS, "normals": np.ones((2, 3), np.float32)}),
    ],
)
def test_content_that_its_reader_refuses_is_not_used_and_is_made_here(stores, share, caplog, kind, content):
    ours, theirs = stores

    def write(path: Path) -> None:
        path.write_bytes(content) if isinstance(content, bytes) else write_npz(path, with_key(KEY, content))

    ours.put(kind, KEY, write)
    assert not theirs.bring(kind, KEY) and not theirs.holds(kind, KEY)
    assert (
        "cannot be read" in warnings(caplog)[-1] and "replaced once it is made again" in warnings(caplog)[-1]
    )
    (there,) = (path for path in share.rglob("*") if path.is_file())
    theirs.put(kind, KEY, lambda path: path.write_bytes(b"{}"))
    assert not there.exists() and theirs.holds(kind, KEY)


def test_shading_that_its_reader_takes_is_used(stores):
    ours, theirs = stores
    ours.put("normals", KEY, lambda path: write_npz(path, with_key(KEY, ARRAYS)))
    assert theirs.bring("normals", KEY)


@pytest.mark.parametrize("kind", ["refined", "raw"])
def test_the_content_of_another_key_is_not_used(stores, caplog, kind):
    ours, theirs = stores

    def write(path: Path) -> None:
        if kind == "refined":
            write_npz(path, with_key(OTHER, {"vertices": np.zeros((3, 3))}))
        else:
            write_exr(path, RenderedFrame({"beauty": np.zeros((2, 2, 3), np.float16)}), {"key": OTHER})

    ours.put(kind, OTHER, write)
    assert theirs.bring(kind, OTHER), "under its own key it is"
    ours.put(kind, KEY, write)
    assert not theirs.bring(kind, KEY)
    assert f"is the content of another file, {OTHER}" in warnings(caplog)[-1]


def test_names_that_nobody_asked_for_are_not_looked_at(stores, monkeypatch):
    ours, theirs = stores
    fill(ours)
    remote = RemoteFiles.of(theirs.url)
    listed, asked = remote.requests.call, []
    digest = "0" * 32
    hostile = [
        f"../../../{KEY}.{digest}.json",
        f"{KEY}.{digest}.json/../../evil.json",
        f"..\\{OTHER}.{digest}.json",
        f"{OTHER}.{digest}.exe",
        f"{OTHER}.{digest}.npz",
        f"{OTHER}.{digest}.json\n",
        f"/etc/{OTHER}",
    ]

    def call(method, *words, **options):
        if method == "ls":
            return [*listed(method, *words, **options), *hostile]
        asked.append(words[0])
        return listed(method, *words, **options)

    monkeypatch.setattr(remote.requests, "call", call)
    assert not theirs.holds("cameras", OTHER)
    assert theirs.bring("cameras", KEY)
    assert all(place.startswith(f"{remote.home}/cameras/a/{KEY}.") for place in asked)
    assert [path.name for path in theirs.root.rglob("*.json")] == [f"{KEY}.json"]

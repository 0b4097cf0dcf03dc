"""Compiled kernels in the remote store: code, so taken by a digest that one trusts."""

import os
import zipfile

import pytest

from flowsculpt.pipeline.plugins.remote.remote_files import RemoteFiles
from flowsculpt.pipeline.production.planning.plan import Plan
from flowsculpt.pipeline.production.store.digests import digest_of
from flowsculpt.pipeline.production.store.remote_store import VARIABLE
from flowsculpt.pipeline.production.store.shared_kernels import (
    fetch_kernels,
    has_kernels,
    kernels_key,
    note_all_compiled,
    send_kernels,
)
from flowsculpt.render.base.kernel_cache import all_kernels, folder_name
from flowsculpt.render.base.user_cache import kernel_homes

pytestmark = pytest.mark.quick


@pytest.fixture
def machine(tmp_path, monkeypatch):
    """Return a function that makes this machine one of a name, with a cache of its own."""

    def become(name):
        monkeypatch.setattr("platformdirs.user_cache_path", lambda _: tmp_path / name)
        return kernel_homes()[1] / folder_name()

    return become


@pytest.fixture
def remote(tmp_path):
    """A remote store, in a folder."""
    (tmp_path / "store").mkdir()
    return RemoteFiles.of(f"file://{tmp_path / 'store'}")


@pytest.fixture
def sent(machine, remote):
    """The name of the kernels that a first machine has compiled and sent."""
    for name in all_kernels():
        (machine("first") / name).mkdir(parents=True)
        (machine("first") / name / "a-1.kernel").write_text(f"kernel of {name}")
        os.utime(machine("first") / name / "a-1.kernel", (1e9, 1e9))  # a fetched one is younger
    note_all_compiled()
    return send_kernels(remote)


def kernels(folder):
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*.kernel")}


def test_a_second_machine_has_all_that_the_first_has_compiled(machine, remote, sent):
    compiled = kernels(machine("first"))
    assert len(compiled) == len(all_kernels())
    second = machine("second")
    assert not has_kernels(kernels_key())
    assert fetch_kernels(remote, sent)
    assert kernels(second) == compiled
    assert has_kernels(kernels_key())
    assert not fetch_kernels(remote, sent), "nothing is fetched twice"
    assert send_kernels(remote) == sent, "the same kernels are the same archive"


def test_a_worker_takes_no_kernels_that_its_plan_does_not_name(machine, remote, sent):
    second = machine("second")
    key, _, digest = sent.partition(".")
    assert not fetch_kernels(remote, f"{key}.{digest[::-1]}")
    assert not fetch_kernels(remote, f"{key[::-1]}.{digest}"), "those are of other sources"
    assert not kernels(second)


def test_a_damaged_archive_is_left_alone(machine, remote, sent, tmp_path):
    second = machine("second")
    (archive,) = (tmp_path / "store").rglob("*.zip")
    archive.write_bytes(archive.read_bytes()[:-9] + b"#########")
    assert not fetch_kernels(remote, sent)
    assert not kernels(second)


def test_a_machine_that_has_not_compiled_all_sends_none(machine, remote):
    machine("third")
    assert send_kernels(remote) == ""


def test_a_plan_for_workers_with_a_store_names_its_kernels(machine, remote, sent, tmp_path, monkeypatch):
    machine("first")
    plan = Plan(requests=(), film=None, jobs=())
    plan.write(tmp_path / "alone.json")
    monkeypatch.setenv(VARIABLE, remote.url)
    plan.write(tmp_path / "shared.json")
    assert Plan.thaw(tmp_path / "alone.json").kernels == ""
    assert Plan.thaw(tmp_path / "shared.json").kernels == sent


@pytest.mark.parametrize("name", ["../../evil.kernel", "{}/../../evil.kernel", "{}/evil.py", "evil/a.kernel"])
def test_nothing_is_taken_of_an_archive_with_other_files(machine, remote, sent, tmp_path, name):
    (archive,) = (tmp_path / "store").rglob("*.zip")
    with zipfile.ZipFile(archive, "a") as packed:
        packed.writestr(name.format(all_kernels()[0]), b"evil")
    archive.rename(archive.with_name(f"{kernels_key()}.{digest_of(archive)}.zip"))
    second = machine("second")
    assert not fetch_kernels(remote)
    assert not kernels(second) and not list(tmp_path.rglob("evil*"))


@pytest.mark.parametrize("damage", ["PK, and no archive", "a damaged kernel"])
def test_nothing_is_taken_of_an_archive_that_cannot_be_read(machine, remote, sent, tmp_path, damage):
    (archive,) = (tmp_path / "store").rglob("*.zip")
    content = archive.read_bytes()
    with zipfile.ZipFile(archive) as packed:
        last = packed.infolist()[-1]
    begin = last.header_offset + 30 + len(last.filename)
    bad = content[:begin] + bytes(last.compress_size) + content[begin + last.compress_size :]
    archive.write_bytes(damage.encode() if damage.startswith("PK") else bad)
    archive.rename(archive.with_name(f"{kernels_key()}.{digest_of(archive)}.zip"))
    second = machine("second")
    assert not fetch_kernels(remote)
    assert not kernels(second)

"""A variant is used only where it was seen to render."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from flowsculpt.render.base.render_errors import BadInputError, MachineError
from flowsculpt.render.mitsuba import engine, llvm
from flowsculpt.render.mitsuba.engine import Engine, choose, works
from flowsculpt.render.mitsuba.llvm import LibLlvm
from tests.processes import HEARS_HANGUPS

pytestmark = pytest.mark.renderer


@pytest.fixture
def empty_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / name)
    return tmp_path


def test_the_scalar_variant_renders_a_sample_anywhere(empty_cache: Path) -> None:
    assert works("scalar_rgb")
    assert len(list(empty_cache.rglob("*.json"))) == 1


def test_an_answer_is_remembered(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert works("scalar_rgb")
    monkeypatch.setattr(engine, "_probe", lambda *_: pytest.fail("probed again"))
    assert works("scalar_rgb")


def test_a_machine_too_busy_to_tell_is_asked_again(
    empty_cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(engine, "PROBE_SECONDS", 0.01)
    assert not works("scalar_rgb")
    monkeypatch.undo()
    assert not list(empty_cache.rglob("*.json"))


def _probes_end_by(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Probes that kill themselves, as the kernel or a crash would."""
    script = folder / "python"
    script.write_text(f"#!/bin/sh\nkill -{name} $$\n")
    script.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(script))


@pytest.mark.parametrize("name", ["KILL", "TERM", "INT", pytest.param("HUP", marks=HEARS_HANGUPS)])
def test_a_probe_killed_from_outside_says_nothing(
    name: str, empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _probes_end_by(name, tmp_path, monkeypatch)
    assert not works("scalar_rgb")
    assert not list(empty_cache.rglob("*.json"))
    monkeypatch.undo()
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / name)
    monkeypatch.setattr(engine, "_probe", lambda *_: True)
    assert works("scalar_rgb")


@pytest.mark.parametrize("name", ["ABRT", "SEGV", "ILL", "BUS"])
def test_a_probe_that_crashes_is_a_remembered_no(
    name: str, empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _probes_end_by(name, tmp_path, monkeypatch)
    assert not works("llvm_ad_rgb")
    monkeypatch.setattr(engine, "_probe", lambda *_: pytest.fail("probed again"))
    assert not works("llvm_ad_rgb")


def test_a_library_that_cannot_render_is_passed_over(
    empty_cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = tmp_path / "libLLVM.so.19.1"
    broken.write_bytes(b"not a library")
    monkeypatch.setattr(llvm, "candidates", lambda: [LibLlvm(broken)])
    chosen = choose()
    assert chosen.variant == "scalar_rgb"
    assert "llvm_ad_rgb did not" in chosen.why
    assert "about twice: `python -m flowsculpt.render.mitsuba.engine`" in chosen.faster


def test_a_cache_that_cannot_be_written_only_costs_a_probe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("")
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: blocked / name)
    assert works("scalar_rgb")


def test_nothing_that_works_is_the_machines_fault(empty_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engine, "_probe", lambda *_: False)
    monkeypatch.setattr(llvm, "candidates", list)
    with pytest.raises(MachineError, match="doctor") as raised:
        choose()
    assert raised.value.exit_code == 4
    assert engine.facts()["renderer"] == "none"


def test_an_unknown_renderer_is_named() -> None:
    with pytest.raises(BadInputError, match="'povray' is not a renderer"):
        choose(["povray"])


def test_a_gpu_is_used_only_when_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def works(variant: str, library: LibLlvm | None = None) -> bool:
        asked.append(variant)
        return True

    monkeypatch.setattr(engine, "works", works)
    monkeypatch.setattr(llvm, "candidates", list)
    assert choose().variant == "scalar_rgb"
    assert choose(["cuda_ad_rgb"]).variant == "cuda_ad_rgb"
    assert asked == ["scalar_rgb", "cuda_ad_rgb"]


def test_one_process_renders_with_one_variant(engine: Engine) -> None:
    other = "scalar_rgb" if engine.variant != "scalar_rgb" else "llvm_ad_rgb"
    with pytest.raises(MachineError, match="cannot change"):
        Engine(other).start()


@pytest.mark.parametrize("name", ["libLLVM-15.so.1", "libLLVM-16.so", "libLLVM.so.16.0", "libLLVM-14.so.1"])
def test_libraries_that_end_the_process_are_never_candidates(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / name).write_bytes(b"")
    (tmp_path / "libLLVM-18.so.1").write_bytes(b"")
    monkeypatch.delenv(llvm.ENVIRONMENT_NAME, raising=False)
    monkeypatch.setattr(llvm, "_SYSTEM_FOLDERS", (str(tmp_path),))
    monkeypatch.setattr(llvm, "provisioned_folder", lambda: tmp_path / "nothing")
    assert [library.version for library in llvm.candidates()] == [18]


def test_the_environments_library_comes_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(llvm.ENVIRONMENT_NAME, str(tmp_path / "mine.so"))
    assert llvm.candidates()[0].path == tmp_path / "mine.so"


def test_a_library_comes_with_what_was_unpacked_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "usr" / "lib"
    folder.mkdir(parents=True)
    for name in ("libLLVM.so.19.1", "libz3.so.4", "libedit.so.2.0.70"):
        (folder / name).write_bytes(b"")
    (folder / "libedit.so.2").symlink_to("libedit.so.2.0.70")
    monkeypatch.delenv(llvm.ENVIRONMENT_NAME, raising=False)
    monkeypatch.setattr(llvm, "provisioned_folder", lambda: tmp_path)
    found = llvm.candidates()[0]
    assert found.version == 19
    assert [path.name for path in found.dependencies] == ["libedit.so.2.0.70", "libz3.so.4"]


def _fake_apt(folder: Path, script: str) -> dict[str, str]:
    """An environment whose apt-get is a shell script, so that set-up meets a failing one."""
    folder.mkdir()
    for tool in ("apt-get", "dpkg"):
        (folder / tool).write_text(f"#!/bin/sh\n{script}\n")
        (folder / tool).chmod(0o755)
    return {**os.environ, "PATH": f"{folder}{os.pathsep}{os.environ['PATH']}"}


@pytest.mark.parametrize(
    ("script", "reason", "seconds"),
    [
        ('echo "E: The lists cannot be fetched" >&2; exit 100', "The lists cannot be fetched", 300.0),
        ("exit 0", "apt offers none", 300.0),
        ("sleep 60", "took too long", 2.0),
    ],
)
def test_a_fetch_that_fails_says_why_and_leaves_nothing(
    script: str, reason: str, seconds: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", _fake_apt(tmp_path / "bin", script)["PATH"])
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "libllvm.tmpkilled").mkdir()
    with pytest.raises(MachineError, match=reason):
        llvm.provision(tmp_path / "lib" / "libllvm", time_limit=seconds)
    assert not list((tmp_path / "lib").iterdir())


def test_set_up_goes_on_where_nothing_can_be_fetched(tmp_path: Path) -> None:
    environment = _fake_apt(tmp_path / "bin", "exit 1")
    environment |= {"XDG_CACHE_HOME": str(tmp_path), llvm.ENVIRONMENT_NAME: ""}
    code = (
        "from pathlib import Path; from flowsculpt.render.mitsuba import engine, llvm\n"
        f"llvm.provisioned_folder = lambda: Path({str(tmp_path / 'lib')!r})\n"
        "llvm._SYSTEM_FOLDERS = ()\n"
        "engine.provide_llvm()"
    )
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("No libLLVM fetched (")
    assert done.stdout == ""

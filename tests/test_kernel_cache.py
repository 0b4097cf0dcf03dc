"""Compiled kernels: made at set-up, never while somebody waits."""

import os
import re
import shutil
import stat
import subprocess
import sys
import tempfile

import pytest
from numba.core.errors import TypingError

from flowsculpt.pipeline.production.store.shared_kernels import has_kernels, kernels_key
from flowsculpt.render.base import kernel_cache, user_cache
from flowsculpt.render.base.kernel_build import build_kernels, kernel_calls
from flowsculpt.render.base.render_errors import MachineError

SCENE = """
from pathlib import Path
from flowsculpt.pipeline.animation import animate
from flowsculpt.pipeline.mesh import split_at_creases
from flowsculpt.pipeline.shot import read_shot
from flowsculpt.render.base.kernel_cache import DECLARED

shot = read_shot(Path({path!r}))
for frame in animate(shot):
    split_at_creases(frame.mesh)
for dispatcher, types in DECLARED:
    if dispatcher.signatures not in ([], [types]):
        print(dispatcher.__name__, dispatcher.signatures)
    if dispatcher.stats.cache_misses:
        print(dispatcher.__name__, "was compiled")
"""


def test_a_whole_shot_runs_on_what_set_up_has_compiled(project):
    if not has_kernels(kernels_key()):  # set-up has been interrupted, or a source edited since
        build_kernels(kernel_calls(), 2, lambda: None)
    scene = SCENE.format(path=str(project.shot))
    done = subprocess.run([sys.executable, "-c", scene], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""


PREPARE = """
from flowsculpt.render.base.kernel_build import compile_module
compile_module({module!r})
"""

BUILD = """
from flowsculpt.render.base.kernel_build import build_kernels
if __name__ == "__main__":
    build_kernels({calls!r}, 2, lambda: None)
"""

CALLED, BETWEEN, CALLER = (
    f"flowsculpt.pipeline.mesh.kernels.{name}" for name in ("halfedge", "normal_kernels", "face_measures")
)


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """A user's cache in which set-up has compiled the kernels of CALLED, BETWEEN and CALLER."""
    cache = tmp_path_factory.mktemp("built")
    code = BUILD.format(calls={CALLED: set(), BETWEEN: {CALLED}, CALLER: {CALLED, BETWEEN}})
    subprocess.run([sys.executable, "-c", code], env={**os.environ, "XDG_CACHE_HOME": str(cache)}, check=True)
    return cache


MEASURE = """
import numpy as np
from flowsculpt.pipeline.kernels import readable
from flowsculpt.pipeline.mesh.kernels.face_measures import lengths_and_areas as kernel
points, faces = readable([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), readable([[0, 1, 2]], np.int32)
assert kernel(points, faces)[1] > 0
print(dict(kernel.stats.cache_misses), len(kernel.stats.cache_hits))
"""


@pytest.mark.slow
def test_a_call_finds_what_set_up_has_compiled(built, tmp_path):
    assert run_code(MEASURE, built, tmp_path) == "{} 1"


@pytest.mark.slow
def test_a_kernel_is_compiled_after_all_that_it_calls_and_once_for_all_its_callers(built):
    assert kernel_calls()[CALLER] == {CALLED, BETWEEN}
    stored = [path for kind in ("kernel", "inner") for path in built.rglob(f"*.{kind}")]
    compiled = [path.name.rpartition("-")[0] for path in stored]
    assert len(compiled) == len(set(compiled))
    assert {"join", "cosines_at_edges", "following"} <= set(compiled), (
        "two that Python calls, and one that only kernels call"
    )


COLD = """
import sys, time
import numpy as np
from {module} import TWIST, deform
print("ready", flush=True)
sys.stdin.readline()
deform(TWIST, np.zeros(12), 0, 1, np.zeros(768), 0)
print(sum(deform.stats.cache_misses.values()), flush=True)
"""


@pytest.mark.slow
def test_of_processes_that_start_cold_at_once_one_compiles_and_no_kill_keeps_the_others_waiting(tmp_path):
    code = COLD.format(module="flowsculpt.pipeline.flow.kernels.deformation_kernels")
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}

    def start():
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        process = subprocess.Popen([sys.executable, "-c", code], env=environment, **pipes)
        assert process.stdout.readline() == "ready\n"
        return process

    def begin(process):
        process.stdin.write("\n")
        process.stdin.flush()

    killed, *others = [start() for _ in range(3)]
    begin(killed)
    while not [*tmp_path.rglob("deform-*.lock")]:
        assert killed.poll() is None
    for process in others:
        begin(process)
    killed.kill()
    killed.communicate()
    assert sorted(process.communicate(timeout=300)[0].strip() for process in others) == ["0", "1"]
    assert not [*tmp_path.rglob("*.lock")]


def test_a_kernel_that_cannot_be_compiled_keeps_nobody_waiting(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    @kernel_cache.compiled()
    def inner(number):
        return number + unknown_name  # noqa: F821

    @kernel_cache.compiled()
    def outer(number):
        return inner(number)

    before = kernel_cache.compiled_seconds()
    with pytest.raises(TypingError):
        outer(1.0)
    assert kernel_cache.compiled_seconds() > before and not [*tmp_path.rglob("*.lock")]


def test_no_vector_library_with_other_bits_is_taken():
    code = "import flowsculpt.pipeline.production, numba.core.config as c\n"
    code += "print(c.DISABLE_INTEL_SVML, c.USING_SVML)"
    environment = {name: value for name, value in os.environ.items() if "SVML" not in name}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert done.stdout.split() == ["1", "False"], done.stderr


@pytest.fixture
def folder_now(tmp_path, monkeypatch):
    """Return a function that finds the cache folder anew: caches are empty, and the user's is in `home`."""
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / "home" / name)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.delenv(user_cache.WARNED, raising=False)

    def ask():
        kernel_cache.cache_folder.cache_clear()
        return kernel_cache.cache_folder()

    yield ask
    kernel_cache.cache_folder.cache_clear()


@pytest.fixture
def digest(tmp_path, monkeypatch):
    """Digests of the modules of a copied checkout, read anew each time."""
    for package in ("pipeline", "render"):
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(kernel_cache.SOURCES / package, tmp_path / package, ignore=ignored)
    monkeypatch.setattr(kernel_cache, "SOURCES", tmp_path)

    def digest_now(module):
        kernel_cache.source_digest.cache_clear()
        return kernel_cache.source_digest(kernel_cache.source_of(module))

    yield digest_now
    kernel_cache.source_digest.cache_clear()


KERNELS = [*kernel_cache.kernel_modules("pipeline"), *kernel_cache.kernel_modules("render")]


def test_an_edit_of_a_source_compiles_the_kernels_that_depend_on_it_and_no_others(tmp_path, digest):
    assert len(KERNELS) > 20
    before = {module: digest(module) for module in KERNELS}
    for edited, *dependants in CALLS:
        file = kernel_cache.source_of(edited)
        file.write_bytes(file.read_bytes() + b"# edited")
        changed = [module for module in KERNELS if digest(module) != before[module]]
        assert set(dependants) <= set(changed)
        assert len(changed) < len(KERNELS) / 2, "some of the others depend on it too, most do not"
        before = {module: digest(module) for module in KERNELS}


CALLS = [
    (
        "flowsculpt.pipeline.flow.kernels.region_kernels",
        "flowsculpt.pipeline.flow.kernels.field_kernels",
        "flowsculpt.pipeline.flow.kernels.streamline_kernels",
    ),
    ("flowsculpt.pipeline.resample.kernels.pass_state", "flowsculpt.pipeline.resample.kernels.collapse"),
    ("flowsculpt.render.raster.raster_shapes", "flowsculpt.render.raster.triangles"),
]
"""A module, and kernels that call or use it."""


def test_every_kernel_is_filed_by_its_module_and_its_sources(tmp_path, digest):
    for module in KERNELS:
        folder = kernel_cache._folder_of.__wrapped__(str(kernel_cache.source_of(module)))
        assert folder == f"{module}-{digest(module)[:16]}"


WHERE = """
from pathlib import Path
from flowsculpt.render.base.kernel_cache import cache_folder
from flowsculpt.render.raster.triangles import draw_triangles
print(Path(draw_triangles.stats.cache_path).relative_to(cache_folder()))
"""


@pytest.mark.slow
def test_a_second_checkout_finds_what_the_first_has_compiled(tmp_path):
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(kernel_cache.SOURCES / "render", tmp_path / "render", ignore=ignored)
    said = [
        subprocess.run(
            [sys.executable, "-c", WHERE],
            env={**os.environ, "PYTHONPATH": str(checkout)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for checkout in (kernel_cache.SOURCES, tmp_path)
    ]
    assert said[0] == said[1] != ""


@pytest.fixture
def no_home(tmp_path):
    """A user's cache that cannot be made."""
    (tmp_path / "home").write_text("a file")


def test_without_a_home_kernels_live_in_a_folder_of_the_users_own(tmp_path, no_home, folder_now):
    folder = folder_now()
    base = tmp_path / f"flowsculpt-cache-{os.getuid()}"
    assert folder.is_relative_to(base)
    assert stat.S_IMODE(base.stat().st_mode) == 0o700
    assert folder_now() == folder


def _open_to_all(folder):
    folder.mkdir()
    folder.chmod(0o777)


def _open_to_a_group(folder):
    folder.mkdir()
    os.chown(folder, -1, SOME_GROUP)
    folder.chmod(0o770)


def _of_somebody_else(folder):
    folder.mkdir(mode=0o700)
    os.chown(folder, SOMEBODY, -1)


def _a_link_of_somebody_else(folder):
    folder.with_name("elsewhere").mkdir(mode=0o700)
    folder.symlink_to(folder.with_name("elsewhere"))
    os.chown(folder, SOMEBODY, -1, follow_symlinks=False)


def _below_a_folder_open_to_all(folder):
    folder.with_name("elsewhere").mkdir()
    (folder.with_name("elsewhere") / "mine").mkdir(mode=0o700)
    folder.with_name("elsewhere").chmod(0o777)
    folder.symlink_to(folder.with_name("elsewhere") / "mine")


SOMEBODY, SOME_GROUP = 4242, 4243

UNSAFE = [
    _open_to_all,
    _open_to_a_group,
    _of_somebody_else,
    _a_link_of_somebody_else,
    _below_a_folder_open_to_all,
]

as_root = pytest.mark.skipif(os.getuid() != 0, reason="only root gives files to others")


@as_root
@pytest.mark.parametrize("set_up", UNSAFE)
def test_a_temporary_folder_that_others_could_have_filled_is_not_trusted(
    set_up, tmp_path, no_home, folder_now
):
    set_up(tmp_path / f"flowsculpt-cache-{os.getuid()}")
    folder = folder_now()
    base = tmp_path / folder.relative_to(tmp_path).parts[0]
    assert re.fullmatch("flowsculpt-cache-[a-z0-9_]{8}", base.name)
    assert stat.S_IMODE(base.stat().st_mode) == 0o700


@as_root
@pytest.mark.parametrize("set_up", UNSAFE)
def test_a_cache_of_the_user_that_others_may_write_is_left_alone_and_named_once(
    set_up, tmp_path, folder_now, capfd
):
    (tmp_path / "home").mkdir()
    set_up(tmp_path / "home/flowsculpt")
    assert folder_now().is_relative_to(tmp_path / f"flowsculpt-cache-{os.getuid()}")
    assert folder_now() == folder_now()
    assert capfd.readouterr().err.count("home/flowsculpt: this cache is not used: ") == 1
    assert not [*tmp_path.glob("home/flowsculpt/*")]


def test_a_new_cache_is_closed_to_others_whatever_the_umask(tmp_path, folder_now):
    before = os.umask(0)
    try:
        folder = folder_now()
    finally:
        os.umask(before)
    assert folder.is_relative_to(tmp_path / "home/flowsculpt")
    assert {stat.S_IMODE((tmp_path / place).stat().st_mode) for place in ("home", "home/flowsculpt")} == {
        0o700
    }


SMALL = """
from flowsculpt.render.base.kernel_cache import compiled

@compiled()
def twice(number):
    return 2 * number

@compiled()
def thrice(number):
    return 3 * number

@compiled()
def half(number):
    return number / 2
"""

CALL = """
import sys
sys.path.insert(0, {folder!r})
from small import half, thrice, twice
assert (half(2), thrice(2), twice(2)) == (1, 6, 4)
print(*[kernel.__name__ for kernel in (half, thrice, twice) if kernel.stats.cache_misses])
"""
"""Calls three kernels; prints those that it has compiled."""


@pytest.fixture(scope="module")
def call(tmp_path_factory):
    """Return the code of CALL, whose kernels are in a folder of their own."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "small.py").write_text(SMALL)
    return CALL.format(folder=str(folder))


@pytest.fixture(scope="module")
def filled(call, tmp_path_factory):
    """A user's cache with the kernels of CALL, filled by two processes at once."""
    cache = tmp_path_factory.mktemp("filled")
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache)}
    command = [sys.executable, "-c", call]
    both = [subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL) for _ in range(2)]
    assert [process.wait() for process in both] == [0, 0]
    return cache


@pytest.mark.slow
def test_a_cache_that_may_only_be_read_is_read_and_nothing_is_kept_elsewhere(call, filled, tmp_path):
    """As in the image of a container, whose cache belongs to root."""
    place, other = shutil.copytree(filled, tmp_path / "cache"), tmp_path / "temporary"
    other.mkdir()
    subprocess.run(["chmod", "-R", "a-w", place], check=True)
    assert run_code(call, place, other, only_reads=True) == ""
    assert not [*other.rglob("*.kernel")]


@pytest.mark.slow
def test_what_two_processes_have_compiled_at_once_is_whole(call, filled, tmp_path):
    assert run_code(call, filled, tmp_path) == ""
    assert len([*filled.rglob("*.kernel")]) == 3
    assert not [*filled.rglob(".*")], "no drafts are left"


@pytest.mark.slow
def test_shipped_kernels_are_used_without_compiling_or_copying_them(call, filled, tmp_path):
    kernels = str(filled / "flowsculpt/kernels")
    shipped = f"import flowsculpt.render.base.user_cache as c; c.SHIPPED = c.Path({kernels!r})"
    assert run_code(f"{shipped}\n{call}", tmp_path / "cache", tmp_path) == ""
    assert not [*tmp_path.rglob("*.kernel")]


DAMAGES = {
    "half": lambda data: data[:-1],
    "thrice": lambda data: data[:99] + b"?" + data[100:],
    "twice": lambda data: b"",
}


@pytest.mark.slow
def test_a_damaged_kernel_is_compiled_again(call, filled, tmp_path):
    shutil.copytree(filled, tmp_path / "cache")
    files = [next(tmp_path.rglob(f"{name}-*.kernel")) for name in DAMAGES]
    for file, damage in zip(files, DAMAGES.values(), strict=True):
        file.write_bytes(damage(file.read_bytes()))
        assert kernel_cache._whole_content(file) is None
    assert run_code(call, tmp_path / "cache", tmp_path) == " ".join(DAMAGES)
    assert all(map(kernel_cache._whole_content, files)), "what was compiled has replaced them"


@pytest.mark.slow
def test_kernels_of_another_level_are_left_alone(call, filled, tmp_path):
    shutil.copytree(filled, tmp_path / "cache")
    assert run_code(call, tmp_path / "cache", tmp_path, level="host") == "half thrice twice"


@pytest.mark.parametrize(
    ("named", "lacks", "level"),
    [
        ("", "", "x86-64-v3"),
        ("", "fma", "host"),
        ("x86-64-v4", "", "x86-64-v4"),
        ("x86-64-v4", "avx512bw", "host"),
        ("host", "", "host"),
    ],
)
def test_a_processor_takes_the_level_that_is_named_or_is_compiled_for_itself(
    named, lacks, level, monkeypatch
):
    features = dict.fromkeys(kernel_cache.LEVELS["x86-64-v4"], True) | {lacks: False}
    monkeypatch.setattr("llvmlite.binding.get_host_cpu_features", lambda: features)
    monkeypatch.setenv(kernel_cache.LEVEL, named)
    assert kernel_cache.cpu_level.__wrapped__() == level


def test_an_unknown_level_is_refused(monkeypatch):
    monkeypatch.setenv(kernel_cache.LEVEL, "zen5")
    with pytest.raises(MachineError, match=r"FLOWSCULPT_CPU=zen5: .* x86-64-v3, x86-64-v4 or host"):
        kernel_cache.cpu_level.__wrapped__()


def run_code(code, cache, temporary, only_reads=False, level=""):
    """Run code with an empty home; as root, without the right to write what root may not."""
    is_root = only_reads and os.getuid() == 0
    humbly = ["setpriv", "--bounding-set=-all", "--inh-caps=-all"] if is_root else []
    command = [*humbly, sys.executable, "-c", code]
    environment = {
        **os.environ,
        "XDG_CACHE_HOME": str(cache),
        "TMPDIR": str(temporary),
        kernel_cache.LEVEL: level,
    }
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.slow
def test_a_full_disk_costs_time_and_no_result(tmp_path):
    file = tmp_path / "twice.py"
    file.write_text(
        "import resource\n"
        "from flowsculpt.render.base.kernel_cache import compiled\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (10, resource.RLIM_INFINITY))\n"
        "@compiled()\n"
        "def twice(number):\n"
        "    return 2 * number\n"
        "assert twice(21) == 42 and twice(1.5) == 3.0\n"
    )
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    done = subprocess.run([sys.executable, file], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_set_up_refuses_a_disk_that_takes_no_kernels(tmp_path):
    code = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (10, resource.RLIM_INFINITY))\n"
    code += PREPARE.format(module="flowsculpt.pipeline.mesh.kernels.face_measures")
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache")}
    done = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True)
    assert "MachineError" in done.stderr and "compiled kernels cannot be stored there" in done.stderr

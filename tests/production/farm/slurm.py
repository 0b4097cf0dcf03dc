"""A SLURM of one node, to try `--profile slurm` on and to test it.

    python tests/production/farm/slurm.py fetch          unpack SLURM from Debian packages under the
                                                         environment, and Snakemake's plugin beside it
    python tests/production/farm/slurm.py run COMMAND…   start it, run a command that finds it, stop it
    python tests/production/farm/slurm.py serve FOLDER   start it there, print its environment as JSON,
                                                         end with stdin

Nothing is installed and root is not needed: the daemons are this user's, keep all they write in one temporary
folder, and listen on this machine's own address, at free ports.
"""

from __future__ import annotations

import json
import os
import secrets
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil

from flowsculpt.render.base.render_errors import MachineError
from flowsculpt.render.mitsuba.llvm import PrivateApt, apt_available

PACKAGES = ("slurmctld", "slurmd", "slurm-client", "munge")

FETCHED = Path(sys.prefix) / "slurm"

REQUIREMENTS = Path(__file__).with_name("requirements.txt")
"""Snakemake's plugin and pandas, which each start of Snakemake would import were they in the environment."""

PATIENCE = 20.0
"""Seconds that daemons have to be ready, and to end."""

CONF = """\
ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
AuthInfo=socket={folder}/munge.socket
PluginDir={plugins}
SlurmctldPort={ports[0]}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool.%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.%n.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
MpiDefault=none
SwitchType=switch/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SchedulerParameters=sched_interval=1,batch_sched_delay=0,sched_min_interval=0
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MinJobAge=3600
ReturnToService=2
KillWait=5
SlurmdDebug=info
PropagateResourceLimits=NONE
{nodes}
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


class SlurmError(Exception):
    """SLURM is not to be had here, or does not start; the message says why."""


@dataclass(frozen=True)
class Programs:
    """Paths of SLURM's and munge's programs and plugins, installed or unpacked under a prefix."""

    prefix: Path

    @classmethod
    def found(cls) -> Programs:
        """Raises SlurmError where there are none."""
        for prefix in (FETCHED, Path("/")):
            found = cls(prefix)
            if all(map(found.has, ("slurmctld", "slurmd", "slurmstepd", "sbatch", "munged"))):
                return found
        raise SlurmError(
            "SLURM is not here; python tests/production/farm/slurm.py fetch unpacks it from Debian packages"
        )

    def has(self, name: str) -> bool:
        return any(path.is_file() for path in self._places(name))

    def path(self, name: str) -> str:
        return str(next(path for path in self._places(name) if path.is_file()))

    def _places(self, name: str) -> Iterator[Path]:
        """Debian's alternatives are links that only an installation makes."""
        for folder in ("usr/sbin", "usr/bin"):
            yield self.prefix / folder / name
            yield self.prefix / folder / f"{name}-wlm"

    @property
    def plugins(self) -> Path:
        found = sorted(self.prefix.glob("usr/lib/*/slurm-wlm"))
        if not found:
            raise SlurmError(
                f"{self.prefix} has SLURM's programs, not its plugins; install slurm-wlm-basic-plugins"
            )
        return found[0]

    @property
    def environment(self) -> dict[str, str]:
        """Variables by which the programs find their libraries."""
        libraries = [str(self.plugins), str(self.plugins.parent), os.environ.get("LD_LIBRARY_PATH", "")]
        return {"LD_LIBRARY_PATH": ":".join(filter(None, libraries))}

    @property
    def commands(self) -> list[str]:
        return [
            name
            for name in ("sbatch", "srun", "squeue", "scancel", "scontrol", "sinfo", "sacct")
            if self.has(name)
        ]


def fetch(time_limit: float = 300.0) -> None:
    """Unpack the packages into FETCHED, which appears whole or not at all.

    Raises SlurmError where apt is missing, offers none, fails or takes too long.
    """
    if not apt_available():
        raise SlurmError("this system has no apt-get and dpkg")
    try:
        with tempfile.TemporaryDirectory(dir=FETCHED.parent, prefix="slurm.tmp") as work:
            apt = PrivateApt(Path(work), time.monotonic() + time_limit)
            apt.update()
            missing = dict.fromkeys(name for package in PACKAGES for name in apt.missing_for(package))
            if not missing:
                raise SlurmError(f"apt offers none of {', '.join(PACKAGES)}")
            apt.unpack(list(missing), Path(work) / "unpacked")
            _install(Path(work) / "unpacked" / "python")
            shutil.rmtree(FETCHED, ignore_errors=True)
            (Path(work) / "unpacked").replace(FETCHED)
    except (MachineError, OSError) as error:
        raise SlurmError(f"SLURM cannot be fetched: {error}") from None


def _install(folder: Path) -> None:
    words = ["--quiet", "--require-hashes", "--no-deps", "--target", str(folder), "-r", str(REQUIREMENTS)]
    if subprocess.run([sys.executable, "-m", "pip", "install", *words]).returncode:
        raise SlurmError(f"{REQUIREMENTS} cannot be installed; pip says why")


@contextmanager
def running(
    folder: Path, cpus: int | None = None, limited: dict[str, int] | None = None
) -> Iterator[dict[str, str]]:
    """SLURM at work, all its files in `folder`; yields the environment in which its commands find it.

    limited  further nodes by name, of one core, which SLURM prefers, and how many bytes a file of their jobs
             may have at most

    Raises SlurmError where it does not start.
    """
    programs = Programs.found()
    environment = {**programs.environment, "SLURM_CONF": str(folder / "slurm.conf")}
    limits = limited or {}
    _write_configuration(folder, programs, cpus or os.cpu_count() or 1, list(limits))
    _write_commands(folder / "bin", programs, environment)
    with ExitStack() as daemons:

        def start(*command: str) -> None:
            log = (folder / f"{Path(command[0]).name}.{command[-1].replace('/', '_')[-20:]}.out").open("wb")
            process = subprocess.Popen(
                command,
                cwd=folder,
                env={**os.environ, **environment},
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )
            log.close()
            daemons.callback(_end, process)

        at = {name: str(folder / f"munge.{name}") for name in ("socket", "key", "pid", "log", "seed")}
        start(
            programs.path("munged"),
            "--foreground",
            "--force",
            *(f"--socket={at['socket']}", f"--key-file={at['key']}", f"--pid-file={at['pid']}"),
            *(f"--log-file={at['log']}", f"--seed-file={at['seed']}"),
        )
        _wait_until(Path(at["socket"]).exists, "munged", folder)
        start(programs.path("slurmctld"), "-D", "-c")
        daemon = (programs.path("slurmd"), "-D", "-c", "-d", programs.path("slurmstepd"), "-N")
        start(*daemon, _host())
        for name, most in limits.items():
            start("prlimit", f"--fsize={most}", *daemon, name)
        _wait_until(lambda: _idle(programs, environment), "the node", folder)
        paths = [str(FETCHED / "python"), os.environ.get("PYTHONPATH", "")]
        yield {"PATH": f"{folder / 'bin'}:{os.environ['PATH']}", "PYTHONPATH": ":".join(filter(None, paths))}


def _host() -> str:
    return socket.gethostname().partition(".")[0]


def _write_configuration(folder: Path, programs: Programs, cpus: int, more: list[str]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("state", *(f"spool.{node}" for node in (_host(), *more))):
        (folder / name).mkdir(exist_ok=True)
    key = folder / "munge.key"
    key.touch(mode=0o600)
    key.write_bytes(secrets.token_bytes(1024))
    ports, memory = _free_ports(2 + len(more)), psutil.virtual_memory().total // 2**20 * 9 // 10
    at = f"NodeHostname={_host()} NodeAddr=127.0.0.1 RealMemory={memory // (1 + len(more))}"
    sizes = {_host(): cpus, **dict.fromkeys(more, 1)}
    nodes = [
        f"NodeName={name} {at} CPUs={sizes[name]} Port={port} Weight={1 + (name not in more)}"
        for name, port in zip(sizes, ports[1:], strict=True)
    ]
    text = CONF.format(
        host=_host(),
        user=psutil.Process().username(),
        folder=folder,
        plugins=programs.plugins,
        ports=ports,
        nodes="\n".join(nodes),
    )
    (folder / "slurm.conf").write_text(text)


def _write_commands(folder: Path, programs: Programs, environment: dict[str, str]) -> None:
    """Commands that know their configuration: what the environment says does not reach every job step."""
    folder.mkdir(exist_ok=True)
    settings = " ".join(f"{name}={shlex.quote(value)}" for name, value in environment.items())
    for name in programs.commands:
        command = folder / name
        command.write_text(f'#!/bin/sh\nexec env {settings} {shlex.quote(programs.path(name))} "$@"\n')
        command.chmod(0o755)


def _free_ports(count: int) -> list[int]:
    with ExitStack() as held:
        sockets = [held.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]


def _idle(programs: Programs, environment: dict[str, str]) -> bool:
    command = [programs.path("sinfo"), "-h", "-o", "%t"]
    done = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True)
    return set(done.stdout.split()) == {"idle"}


def _wait_until(ready: object, what: str, folder: Path) -> None:
    assert callable(ready)
    deadline = time.monotonic() + PATIENCE
    while not ready():
        if time.monotonic() > deadline:
            told = [
                line for log in sorted(folder.glob("*.out")) for line in log.read_text().splitlines()[-3:]
            ]
            raise SlurmError(f"{what} is not ready after {PATIENCE:.0f} s; {' / '.join(told) or folder}")
        time.sleep(0.1)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a daemon and what it started."""
    family = psutil.Process(process.pid).children(recursive=True) if process.poll() is None else []
    process.terminate()
    try:
        process.wait(PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    for member in family:
        if member.is_running():
            member.kill()


def main(words: list[str]) -> int:
    try:
        match words:
            case ["fetch"]:
                fetch()
                print(f"SLURM unpacked in {FETCHED}")
            case ["run", *command] if command:
                with tempfile.TemporaryDirectory(prefix="slurm") as folder, running(Path(folder)) as found:
                    return subprocess.run(command, env={**os.environ, **found}).returncode
            case ["serve", folder]:
                signal.signal(signal.SIGINT, signal.SIG_IGN)  # who reads from it decides when it ends
                with running(Path(folder)) as found:
                    print(json.dumps(found), flush=True)
                    sys.stdin.read()
            case _:
                print(__doc__, file=sys.stderr)
                return 2
    except SlurmError as error:
        print(error, file=sys.stderr)
        return 4
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

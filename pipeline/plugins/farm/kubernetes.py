"""A plan as Kubernetes manifests: a ConfigMap with the plan, and for each step a Job, in files by level.

A level waits for the one before; `run.sh` creates them in this order. Each Job is indexed: its pod with index
I does the part I of the step's frames, `flowsculpt task PLAN SHOT/render --part I/N`, in an empty folder of
its own. What pods share is the remote store.
Source: https://kubernetes.io/docs/concepts/workloads/controllers/job/ (batch/v1; GA since 1.33).
"""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from flowsculpt import UsageError
from flowsculpt.api import plural
from flowsculpt.api.files import to_plain
from flowsculpt.api.frames import VARIABLE, Plan, key_of
from flowsculpt.pipeline.plugins.farm.farm_steps import FarmStep, steps_of

CHUNK = 8  # frames of a pod: each costs the start of a container and a renderer
RETRIES = 2  # times that a failed pod is replaced
FOR_GOOD = (2, 3)  # exit codes that another attempt would end with too: bad usage, a missing input

SECRET = "flowsculpt-store"
"""The secret whose entries pods get as environment variables, if it is there: credentials of the store."""

PLAN_FILE, SCRIPT = "0-plan.yaml", "run.sh"
"""Files beside those of the Jobs: the ConfigMap, and the script that creates all."""

MOST_LETTERS = 50  # letters of a Job's name: with an index it names pods, which may have 63
MOST_BYTES = 900_000  # size of a plan in a ConfigMap, which may have 1 MiB with all that is around it

EVERYWHERE = "kubernetes"  # the name of a plan in a cluster, and of its host

PLAN, WORK = Path("/plan"), Path("/show")
"""Folders of a pod: of the plan, and of its outputs."""


@dataclass(frozen=True)
class KubernetesJob:
    """A whole plan as a job of Kubernetes; a pod asks for `threads` cores.

    side_by_side  the most pods of a step at once

    Raises UsageError where there is no store that pods reach, and for a plan too large for a ConfigMap.
    """

    plan: Plan
    image: str
    store: str | None
    threads: int
    side_by_side: int

    def __post_init__(self) -> None:
        if self.store is None or self.store.startswith(("file:", "local:", "memory:")):
            raise UsageError(
                "export kubernetes: pods share no disk, so they need a remote store that all reach; name one "
                "by --store s3://BUCKET/PREFIX"
            )
        if len(self._text) > MOST_BYTES:
            raise UsageError(
                f"export kubernetes: a plan of {plural(len(self.plan.targets), 'file')} does not fit into a "
                "ConfigMap, which may have 1 MiB; export fewer shots at once"
            )

    def manifests(self) -> dict[str, list[dict[str, Any]]]:
        """Return the objects of each file by its name: the plan, then the Jobs of each level."""
        config = {
            "apiVersion": "v1",
            "kind": "ConfigMap",
            "metadata": {"name": self._config, "labels": self._labels},
            "immutable": True,
            "data": {"plan.json": self._text},
        }
        return {PLAN_FILE: [config]} | {
            file: [self._job(step, level) for step in steps]
            for level, (file, steps) in enumerate(self._levels.items(), 1)
        }

    def script(self) -> str:
        """Return the shell script that creates the Jobs of each level when those before are complete."""
        return _SCRIPT.format(
            plan=PLAN_FILE, files=" ".join(self._levels), digest=self._digest, states=_STATES
        )

    @cached_property
    def _text(self) -> str:
        """The plan, without when and where it was made: of the same shots it is the same."""
        return json.dumps(to_plain(replace(self.plan, name=EVERYWHERE, host=EVERYWHERE)))

    @cached_property
    def _digest(self) -> str:
        """Names the objects: those in a cluster cannot be changed, so another plan has others."""
        return key_of("kubernetes", self._text, self.image, self.store, self.threads)[:8]

    @property
    def _config(self) -> str:
        return f"flowsculpt-plan-{self._digest}"

    @property
    def _labels(self) -> dict[str, str]:
        return {"app.kubernetes.io/name": "flowsculpt", "flowsculpt/plan": self._digest}

    @cached_property
    def _levels(self) -> dict[str, list[FarmStep]]:
        """The steps by the files of their Jobs: a file waits for those before it, and for none of its own."""
        steps, depths = steps_of(self.plan), list[int]()
        for step in steps:
            depths.append(1 + max((depths[other] for other in step.after), default=0))
        files = {}
        for depth in sorted(set(depths)):
            level = [step for step, d in zip(steps, depths, strict=True) if d == depth]
            files[f"{depth}-{'-'.join(dict.fromkeys(step.kind.lower() for step in level))}.yaml"] = level
        return files

    def _job(self, step: FarmStep, level: int) -> dict[str, Any]:
        """Return the Job of a step: its pods share out the frames, and each is replaced where it fails."""
        parts = _parts(step)
        retry = [
            # A node that is drained or preempted is no failure of the pod.
            {"action": "Ignore", "onPodConditions": [{"type": "DisruptionTarget", "status": "True"}]},
            {
                "action": "FailIndex",
                "onExitCodes": {"containerName": "task", "operator": "In", "values": list(FOR_GOOD)},
            },
        ]
        return {
            "apiVersion": "batch/v1",
            "kind": "Job",
            "metadata": {
                "name": _name(step, self._digest),
                "labels": {**self._labels, "flowsculpt/level": str(level)},
            },
            "spec": {
                "completionMode": "Indexed",
                "completions": parts,
                "parallelism": min(parts, self.side_by_side),
                "backoffLimitPerIndex": RETRIES,
                "podFailurePolicy": {"rules": retry},
                "template": {"metadata": {"labels": self._labels}, "spec": self._pod(step)},
            },
        }

    def _pod(self, step: FarmStep) -> dict[str, Any]:
        """Return the specification of a step's pods."""
        memory, gpu = f"{step.memory_mib}Mi", {"nvidia.com/gpu": str(step.gpus)} if step.gpus else {}
        container = {
            "name": "task",
            "image": self.image,
            "securityContext": {"allowPrivilegeEscalation": False, "capabilities": {"drop": ["ALL"]}},
            "command": ["sh", "-c", _command(step, self.threads)],
            "workingDir": str(WORK),
            "env": [{"name": VARIABLE, "value": self.store}],
            "envFrom": [{"secretRef": {"name": SECRET, "optional": True}}],
            "resources": {
                "requests": {"cpu": str(self.threads), "memory": memory},
                "limits": {"memory": memory, **gpu},
            },
            "volumeMounts": [
                {"name": "plan", "mountPath": str(PLAN), "readOnly": True},
                {"name": "show", "mountPath": str(WORK)},
            ],
        }
        return {
            "restartPolicy": "Never",
            "securityContext": {"runAsNonRoot": True, "seccompProfile": {"type": "RuntimeDefault"}},
            "activeDeadlineSeconds": 60 * step.minutes(self.threads, CHUNK),
            "containers": [container],
            "volumes": [
                {"name": "plan", "configMap": {"name": self._config}},
                {"name": "show", "emptyDir": {}},
            ],
        }


def _parts(step: FarmStep) -> int:
    """Return how many pods share the work of a step."""
    return max(1, -(-len(step.frames) // CHUNK))


def _command(step: FarmStep, threads: int) -> str:
    """Return what a pod does, in words of a shell."""
    tasks = [step.task] if step.frames else [job.name for job in step.jobs]
    words = [
        "exec",
        "flowsculpt",
        "--no-progress",
        "-j",
        str(threads),
        "task",
        str(PLAN / "plan.json"),
        *tasks,
    ]
    part = f' --part "$JOB_COMPLETION_INDEX/{_parts(step)}"' if step.frames else ""
    return shlex.join(words) + part


def _name(step: FarmStep, digest: str) -> str:
    """Return the name of a step's Job: letters, digits and `-` alone. Two shots never share one."""
    shot = re.sub(r"[^a-z0-9]+", "-", step.shot.lower()).strip("-")
    unique = key_of("step", step.kind, step.shot)[:4]
    return f"flowsculpt-{step.kind.lower()}-{shot}"[: MOST_LETTERS - 14].strip("-") + f"-{unique}-{digest}"


_SCRIPT = """\
#!/bin/sh
# Run the jobs of this folder in a Kubernetes cluster, one level after the other: sh run.sh [-n NAMESPACE]
# Run it again to continue where it stopped. To retry failed jobs, delete them first: kubectl delete -f FILE
set -eu
cd "$(dirname "$0")"
kubectl "$@" apply -f {plan}
level=0
for file in {files}; do
    level=$((level + 1))
    kubectl "$@" apply -f "$file"
    while :; do
        states=$(kubectl "$@" get jobs -l "flowsculpt/plan={digest},flowsculpt/level=$level" \\
            -o jsonpath='{states}')
        if failed=$(echo "$states" | grep -w Failed); then
            echo "$failed" >&2
            echo "kubectl logs -l job-name=NAME says why. Files after $file were not started." >&2
            exit 1
        fi
        echo "$states" | grep -qvw Complete || break
        sleep 5
    done
done
echo "Done. Where you work, flowsculpt render or film with the same --store fetches frames and movies."
"""

_STATES = '{range .items[*]}{.metadata.name}{" "}{.status.conditions[?(@.status=="True")].type}{"\\n"}{end}'
"""For each Job a line of its name and the conditions that are true: `Complete` or `Failed` at its end."""

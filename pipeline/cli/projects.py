"""The project that a command works in, as its options say."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.cli.options import Common
from pipeline.production.execution.project import Project


def project_of(
    common: Common, settings: Sequence[str] | None, allow_code: bool, variant: str | None = None
) -> Project:
    return Project(common.root, common.cores, variant, tuple(settings or ()), allow_code, common.profile)

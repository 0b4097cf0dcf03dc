"""The contract of plug-ins for what is called around runs and deliveries: the door `observer`."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from flowsculpt.pipeline.cli.options import Common
from flowsculpt.pipeline.plugin import plugins
from flowsculpt.pipeline.production.planning.plan import Plan


class RunObserver:
    """Called around runs and deliveries. A plug-in's class overrides what it needs; the rest does nothing.

    An object of the class is made without arguments, once in a process. A FlowsculptError that a method
    raises ends the command with its message.
    """

    @staticmethod
    def of_plugins() -> list[RunObserver]:
        """Return the observers of all plug-ins, in the order in which they are called."""
        return list(plugins().objects("observer", RunObserver).values())

    def watch(self, common: Common, plan: Plan, preview: bool) -> AbstractContextManager[object]:
        """Return a context that is entered while `render` or `film` executes a plan at a terminal.

        common   the options that every command has, among them the root and the profile
        plan     the jobs, and the requests that they belong to
        preview  False where the user wants no previews
        """
        return nullcontext()

    def summary(self, common: Common, run: str) -> str:
        """Return a line for the report of a run that has ended, done or failed; an empty one for none.

        run  its name; its events are in the file RUN.jsonl of the folder `EVENTS`
        """
        return ""

    def delivered(self, common: Common, delivery: Mapping[str, Any]) -> None:
        """Take note of files of `deliver`, which are all there.

        delivery  what `deliver --json` prints: `deliverables`, each with `path`, `as`, `frames` and
                  `up_to_date`; `failed`, lines about frames that are shown as cards; and `seconds`
        """

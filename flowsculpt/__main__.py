"""The command `flowsculpt`, also `python -m flowsculpt`.

Modules are imported where Ctrl-C ends the command without a traceback.
"""

from __future__ import annotations

import os
import sys

MACHINE, INTERRUPTED = 4, 130

MOST_DIGITS = 11
"""Digits of the largest number in a variable: numpy fails for a year that the system does not know."""


def main() -> None:
    """Run the command line."""
    try:
        _start()
    except KeyboardInterrupt:  # until `_end` is set
        os._exit(INTERRUPTED)


def _start() -> None:
    import signal

    if signal.getsignal(signal.SIGINT) == signal.default_int_handler:
        signal.signal(signal.SIGINT, _end)
    if asked := "_FLOWSCULPT_COMPLETE" in os.environ:  # a shell asks at each Tab
        here = os.getcwd()  # noqa: PTH109  # a Path takes time to import
        sys.path[:] = [entry for entry in sys.path if os.path.isabs(entry) and entry != here]  # noqa: PTH117
        from importlib import import_module

        completion = import_module("flowsculpt.pipeline.plugins.completion.tab_answers")
        if completion.answer(sys.argv[1:]):
            return
    from flowsculpt.render.base.python_process import distrust_working_folder, postpone_collection, prepare

    prepare()
    distrust_working_folder()  # which `python -m` has put first, before anything else is imported
    _require_packages()
    _require_whole_numbers()
    postpone_collection()
    if asked:
        import_module("flowsculpt.pipeline.plugins.completion.completion_command").write_table()
        completion.answer(sys.argv[1:])
        return
    from flowsculpt.pipeline.cli.app import main as start
    from flowsculpt.render.base.standard_streams import prepare_streams

    prepare_streams()
    try:
        start()
    finally:
        if signal.getsignal(signal.SIGINT) != signal.SIG_IGN:
            signal.signal(signal.SIGINT, _end)


def _require_packages() -> None:
    """End with one line where only the library is installed, which needs none of these packages."""
    from importlib.util import find_spec

    missing = [name for name in ("typer", "snakemake", "mitsuba") if find_spec(name) is None]
    if missing:
        sys.stderr.write(
            f"error: flowsculpt is installed as a library, without {missing[0]} and other packages that its "
            "commands need; install them: pip install 'flowsculpt[film]'\n"
        )
        sys.exit(MACHINE)


def _require_whole_numbers() -> None:
    """End with one line where a variable that numpy or typer reads when it is imported is not a number."""
    for name in ("NUMPY_MADVISE_HUGEPAGE", "SOURCE_DATE_EPOCH", "TERMINAL_WIDTH"):
        if not (value := os.environ.get(name, "")).strip():
            os.environ.pop(name, None)
            continue
        try:
            if len(str(int(value))) > MOST_DIGITS:
                raise ValueError
        except ValueError:
            fact = (
                f"is {value!r} in the environment, and must be a whole number of up to {MOST_DIGITS} digits"
            )
            sys.stderr.write(f"error: {name} {fact}; correct or unset it\n")
            sys.exit(MACHINE)


def _end(number: int, frame: object) -> None:
    """End at once on Ctrl-C: nothing has begun yet, or everything is done."""
    os._exit(INTERRUPTED)


if __name__ == "__main__":
    main()

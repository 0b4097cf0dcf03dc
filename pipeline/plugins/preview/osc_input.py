"""Open Sound Control by UDP on this machine: every number of a message is a control."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from flowsculpt import MachineError, UsageError
from flowsculpt.pipeline.plugins.preview.control_inputs import Moved

ADDRESS = "127.0.0.1"

MOST_NUMBERS = 16  # of a message that are heard


def osc_controls(address: str, arguments: tuple[Any, ...]) -> Moved:
    """Return what a message moves: `osc /fader`, and of several numbers `osc /xy 0`, `osc /xy 1`."""
    numbers = [float(each) for each in arguments[:MOST_NUMBERS] if isinstance(each, int | float)]
    name = f"osc {address[:80]}"
    names = [name] if len(numbers) == 1 else [f"{name} {i}" for i in range(len(numbers))]
    return [(each, number) for each, number in zip(names, numbers, strict=True) if math.isfinite(number)]


@contextmanager
def osc_input(port: int, heard: Callable[[Moved], None]) -> Iterator[None]:
    """Call `heard` with what each message moves, from another thread, until the context ends.

    Raises UsageError where python-osc is not installed, MachineError where the port is taken.
    """
    try:
        from pythonosc.dispatcher import Dispatcher
        from pythonosc.osc_server import BlockingOSCUDPServer
    except ImportError:
        raise UsageError(
            "--osc needs the package python-osc; install the extra: pip install 'flowsculpt[perform]'"
        ) from None
    dispatcher = Dispatcher()
    dispatcher.set_default_handler(lambda address, *arguments: heard(osc_controls(address, arguments)))
    try:
        server = BlockingOSCUDPServer((ADDRESS, port), dispatcher)
    except OSError as error:
        raise MachineError(
            f"port {port} of this machine cannot be used for OSC ({error.strerror}); give --osc another one"
        ) from error
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()

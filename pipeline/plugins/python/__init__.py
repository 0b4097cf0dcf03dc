"""Python: functions of Python files as flows."""

from flowsculpt.api import Plugin

PLUGIN = Plugin(
    name="python",
    version="",
    flows={"python": "flowsculpt.pipeline.plugins.python.python_document:PythonDocument"},
)

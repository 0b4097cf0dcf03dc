"""flowsculpt: from a shot file to mesh frames, and the production around them.

The layers import downwards only; `docs/architecture.md` draws them.
"""

if __name__ == "pipeline":  # in a checkout; everything would be imported a second time
    raise ModuleNotFoundError("import flowsculpt.pipeline", name=__name__)

"""flowsculpt: from a shot file to mesh frames, and the production around them.

The layers import downwards only; `docs/architecture.md` draws them.
"""

"""From arrays to pictures and films. Knows no shot and no flow, and never imports `pipeline`.

The public names, each imported from its module when first used:

    from flowsculpt.render import LIGHTS, LOOKS, QUALITIES, Scene, Surface, choose, denoise, render_frame
"""

from flowsculpt import lazy_names
from flowsculpt.render.base.python_process import is_own, prepare

if __name__ == "render":  # in a checkout; everything would be imported a second time
    raise ModuleNotFoundError("import flowsculpt.render", name=__name__)

if is_own():
    prepare()

__all__, __getattr__ = lazy_names(__name__, __file__)

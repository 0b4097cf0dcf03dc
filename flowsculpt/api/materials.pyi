"""Looks as values: materials, their patterns and textures, surfaces that have them, and lights."""

from flowsculpt.render.scene.materials import LOOKS as LOOKS
from flowsculpt.render.scene.materials import Diffuse as Diffuse
from flowsculpt.render.scene.materials import Material as Material
from flowsculpt.render.scene.materials import Opacity as Opacity
from flowsculpt.render.scene.materials import Satin as Satin
from flowsculpt.render.scene.measured_colours import with_known as with_known
from flowsculpt.render.scene.painted_faces import PaintedFaces as PaintedFaces
from flowsculpt.render.scene.patterns import Pigment as Pigment
from flowsculpt.render.scene.rgb_spaces import linear_of_srgb as linear_of_srgb
from flowsculpt.render.scene.rgb_spaces import srgb_of_linear as srgb_of_linear
from flowsculpt.render.scene.scene_lights import LightRig as LightRig
from flowsculpt.render.scene.surface import Surface as Surface
from flowsculpt.render.scene.textures import Texture as Texture

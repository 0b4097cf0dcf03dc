"""Looks as values: materials, their textures, and the lights and stage around them."""

from flowsculpt.render.post.embedded_textures import EmbeddedPicture as EmbeddedPicture
from flowsculpt.render.scene.materials import BrushedMetal as BrushedMetal
from flowsculpt.render.scene.materials import Diffuse as Diffuse
from flowsculpt.render.scene.materials import Glass as Glass
from flowsculpt.render.scene.materials import Glossy as Glossy
from flowsculpt.render.scene.materials import Gouraud as Gouraud
from flowsculpt.render.scene.materials import Metal as Metal
from flowsculpt.render.scene.materials import MitsubaMaterial as MitsubaMaterial
from flowsculpt.render.scene.materials import Opacity as Opacity
from flowsculpt.render.scene.materials import PatternedMaterial as PatternedMaterial
from flowsculpt.render.scene.materials import Plastic as Plastic
from flowsculpt.render.scene.materials import Satin as Satin
from flowsculpt.render.scene.materials import Smoke as Smoke
from flowsculpt.render.scene.rgb_spaces import srgb_of_linear as srgb_of_linear
from flowsculpt.render.scene.scene_lights import Softbox as Softbox
from flowsculpt.render.scene.scene_lights import Sun as Sun
from flowsculpt.render.scene.scene_stage import Stage as Stage
from flowsculpt.render.scene.texture_projection import TextureProjection as TextureProjection
from flowsculpt.render.scene.textures import Texture as Texture

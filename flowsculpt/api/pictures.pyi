"""Pictures and movies: previews, files, cameras, captions, encodes, sound."""

from flowsculpt.pipeline.production.request.audio import AudioClip as AudioClip
from flowsculpt.pipeline.production.tasks.finish import write_finished as write_finished
from flowsculpt.render.base.render_errors import RenderError as RenderError
from flowsculpt.render.graphics.contact_sheet import ContactSheet as ContactSheet
from flowsculpt.render.graphics.typesetting import BurnIn as BurnIn
from flowsculpt.render.graphics.typesetting import Font as Font
from flowsculpt.render.movie.codecs import ENCODES as ENCODES
from flowsculpt.render.movie.codecs import Encode as Encode
from flowsculpt.render.movie.encode import write_movie as write_movie
from flowsculpt.render.movie.movie_frames import loop_frames as loop_frames
from flowsculpt.render.movie.movie_frames import mix_frames as mix_frames
from flowsculpt.render.movie.movie_frames import prefetch as prefetch
from flowsculpt.render.movie.movie_frames import to_pixel_format as to_pixel_format
from flowsculpt.render.post.hdr import HDR_DISPLAYS as HDR_DISPLAYS
from flowsculpt.render.post.image import jpeg_bytes as jpeg_bytes
from flowsculpt.render.post.image import read_exr as read_exr
from flowsculpt.render.post.image import read_header as read_header
from flowsculpt.render.post.image import read_png as read_png
from flowsculpt.render.post.image import write_exr as write_exr
from flowsculpt.render.post.image import write_still as write_still
from flowsculpt.render.raster import Shape as Shape
from flowsculpt.render.raster import draw_preview as draw_preview
from flowsculpt.render.scene.aovs import RenderedFrame as RenderedFrame
from flowsculpt.render.scene.render_camera import Camera as Camera

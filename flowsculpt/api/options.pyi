"""Parameters of commands: annotated types that typer reads, and the values of options that several share."""

from flowsculpt.pipeline.cli.options import AllowCode as AllowCode
from flowsculpt.pipeline.cli.options import Common as Common
from flowsculpt.pipeline.cli.options import Crop as Crop
from flowsculpt.pipeline.cli.options import Crossings as Crossings
from flowsculpt.pipeline.cli.options import Force as Force
from flowsculpt.pipeline.cli.options import FrameNumbers as FrameNumbers
from flowsculpt.pipeline.cli.options import Frames as Frames
from flowsculpt.pipeline.cli.options import PictureOptions as PictureOptions
from flowsculpt.pipeline.cli.options import Plot as Plot
from flowsculpt.pipeline.cli.options import Quality as Quality
from flowsculpt.pipeline.cli.options import Scale as Scale
from flowsculpt.pipeline.cli.options import Settings as Settings
from flowsculpt.pipeline.cli.options import Shot as Shot
from flowsculpt.pipeline.cli.options import ShotOptions as ShotOptions
from flowsculpt.pipeline.cli.options import Shots as Shots
from flowsculpt.pipeline.cli.options import Subject as Subject
from flowsculpt.pipeline.cli.options import Variant as Variant
from flowsculpt.pipeline.cli.options import at_option as at_option
from flowsculpt.pipeline.cli.options import frames_option as frames_option
from flowsculpt.pipeline.cli.options import output_option as output_option
from flowsculpt.pipeline.cli.options import quality_option as quality_option
from flowsculpt.pipeline.cli.options import shots_argument as shots_argument
from flowsculpt.render.scene.render_quality import DEFAULT_QUALITY as DEFAULT_QUALITY
from flowsculpt.render.scene.render_quality import QUALITIES as QUALITIES

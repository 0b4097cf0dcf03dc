"""Parameters of commands: annotated types that typer reads, and the values of options that several share."""

from flowsculpt.pipeline.cli.options import Common as Common
from flowsculpt.pipeline.cli.options import Frames as Frames
from flowsculpt.pipeline.cli.options import PictureOptions as PictureOptions
from flowsculpt.pipeline.cli.options import Quality as Quality
from flowsculpt.pipeline.cli.options import Shot as Shot
from flowsculpt.pipeline.cli.options import ShotOptions as ShotOptions
from flowsculpt.pipeline.cli.options import shared_option as shared_option
from flowsculpt.render.scene.render_quality import DEFAULT_QUALITY as DEFAULT_QUALITY

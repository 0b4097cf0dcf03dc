"""What plug-ins add, and the errors and words that all of them share; the facades beside it have the rest."""

from flowsculpt.pipeline.cli.execution import RunObserver as RunObserver
from flowsculpt.pipeline.errors import ShotError as ShotError
from flowsculpt.pipeline.errors import VertexBudgetError as VertexBudgetError
from flowsculpt.pipeline.errors import quote as quote
from flowsculpt.pipeline.errors import shorten as shorten
from flowsculpt.pipeline.errors import suggest as suggest
from flowsculpt.pipeline.long_computations import Progress as Progress
from flowsculpt.pipeline.plugin import Command as Command
from flowsculpt.pipeline.plugin import FileFormat as FileFormat
from flowsculpt.pipeline.plugin import PictureStage as PictureStage
from flowsculpt.pipeline.plugin import Plugin as Plugin
from flowsculpt.pipeline.plugin import ShotEntry as ShotEntry
from flowsculpt.pipeline.plugin import plugins as plugins
from flowsculpt.pipeline.production.shot_extras import Animation as Animation
from flowsculpt.pipeline.production.shot_extras import ShotExtras as ShotExtras
from flowsculpt.pipeline.production.store.remote_store import RemoteStores as RemoteStores
from flowsculpt.pipeline.resample import PolygonMethod as PolygonMethod
from flowsculpt.pipeline.resample import PolygonReport as PolygonReport
from flowsculpt.pipeline.resample import PolygonResampler as PolygonResampler
from flowsculpt.pipeline.shot.documents.subject_kinds import CopyLayout as CopyLayout
from flowsculpt.pipeline.shot.documents.subject_kinds import MovingKind as MovingKind
from flowsculpt.pipeline.shot.documents.subject_kinds import PointsKind as PointsKind
from flowsculpt.pipeline.shot.documents.subject_kinds import SubjectKind as SubjectKind
from flowsculpt.render.base.plural import plural as plural

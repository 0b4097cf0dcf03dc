"""Resampling; `__init__.py` imports each name from its module when it is first used."""

from flowsculpt.pipeline.resample.placement import Chord as Chord
from flowsculpt.pipeline.resample.placement import Curved as Curved
from flowsculpt.pipeline.resample.placement import Exact as Exact
from flowsculpt.pipeline.resample.placement import Placement as Placement
from flowsculpt.pipeline.resample.polygonal_methods import PolygonMethod as PolygonMethod
from flowsculpt.pipeline.resample.polygonal_methods import PolygonResampler as PolygonResampler
from flowsculpt.pipeline.resample.polygonal_methods import polygon_method as polygon_method
from flowsculpt.pipeline.resample.polygonal_methods import polygon_methods as polygon_methods
from flowsculpt.pipeline.resample.resample_pass import PolygonReport as PolygonReport
from flowsculpt.pipeline.resample.resample_pass import Report as Report
from flowsculpt.pipeline.resample.resampler import Resampler as Resampler
from flowsculpt.pipeline.resample.resampler import resample as resample
from flowsculpt.pipeline.resample.thresholds import Curvature as Curvature
from flowsculpt.pipeline.resample.thresholds import DistanceToCamera as DistanceToCamera
from flowsculpt.pipeline.resample.thresholds import ThresholdFormula as ThresholdFormula
from flowsculpt.pipeline.resample.thresholds import Thresholds as Thresholds
from flowsculpt.pipeline.resample.thresholds import edges_by_angle as edges_by_angle
from flowsculpt.pipeline.resample.thresholds import edges_in_region as edges_in_region

"""Fields: velocities by formulas, on grids in files, turbulence, attraction to shapes, wind along curves.

Files of VTK are read here, also those of surfaces.
"""

from flowsculpt.api import Command, FileFormat, Plugin

_DOCUMENTS = "flowsculpt.pipeline.plugins.fields.field_documents"
_SURFACES = "flowsculpt.pipeline.plugins.fields.vtk_surfaces"
_SERIES = "flowsculpt.pipeline.plugins.fields.vtk_series:open_series"

PLUGIN = Plugin(
    name="fields",
    version="",
    flows={
        "formula": "flowsculpt.pipeline.plugins.fields.formula_document:FormulaDocument",
        "curl_noise": "flowsculpt.pipeline.plugins.fields.curl_noise:CurlNoise",
        "attraction": f"{_DOCUMENTS}:AttractionDocument",
        "wind": f"{_DOCUMENTS}:WindDocument",
        "sampled": f"{_DOCUMENTS}:SampledDocument",
    },
    commands={
        "data": Command(
            "flowsculpt.pipeline.plugins.fields.data_command:data",
            "List what a file of measured or simulated fields holds.",
            "Look",
        )
    },
    formats={
        **dict.fromkeys(("vtp", "vtu"), FileFormat(f"{_SURFACES}:VTK")),
        **dict.fromkeys(("pvtp", "pvtu"), FileFormat(f"{_SURFACES}:VTK_OF_FILES")),
        "pvd": FileFormat(f"{_SURFACES}:VTK_OF_FILES", motion=_SERIES),
    },
)

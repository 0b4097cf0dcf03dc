"""Fields: velocities by formulas, on grids in files, turbulence, attraction to shapes, wind along curves."""

from flowsculpt.api import Command, Plugin

_DOCUMENTS = "flowsculpt.pipeline.plugins.fields.field_documents"

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
        ),
    },
)

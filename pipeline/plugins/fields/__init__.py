"""Fields: velocities on grids in files, turbulence, attraction to shapes, and wind along curves."""

from flowsculpt.api import Plugin

_DOCUMENTS = "flowsculpt.pipeline.plugins.fields.field_documents"

PLUGIN = Plugin(
    name="fields",
    version="",
    flows={
        "curl_noise": "flowsculpt.pipeline.plugins.fields.curl_noise:CurlNoise",
        "attraction": f"{_DOCUMENTS}:AttractionDocument",
        "wind": f"{_DOCUMENTS}:WindDocument",
        "sampled": f"{_DOCUMENTS}:SampledDocument",
    },
)

"""Variables of files that follow the CF conventions which are numbers, such as temperatures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flowsculpt.pipeline.plugins.fields.cf_conventions import EAST, NORTH, text
from flowsculpt.pipeline.plugins.fields.cf_files import CFSamples
from flowsculpt.pipeline.plugins.fields.grid_layout import FLAT, SPHERE
from flowsculpt.pipeline.plugins.fields.stored_arrays import opened_together

_CELSIUS = ("degc", "deg c", "deg_c", "celsius", "degree_celsius", "degrees_celsius", "degree_c", "degrees_c")
SHOWN = dict.fromkeys(_CELSIUS, "°C") | {
    "degf": "°F",
    "kelvin": "K",
    "m s-1": "m/s",
    "m s**-1": "m/s",
    "meter second-1": "m/s",
    "s-1": "1/s",
    "1e-3": "‰",
    "0.001": "‰",
    "psu": "PSU",
    "percent": "%",
    "kg m-3": "kg/m³",
    "mg m-3": "mg/m³",
    "w m-2": "W/m²",
    "m2 s-2": "m²/s²",
    "1": "",
}
"""Units as readers know them, by those that files write."""


class CFNumbers(CFSamples):
    """Numbers in place of velocities: the value where it is known, 1 where it is, and 1."""

    is_paced = False

    @property
    def geometry(self) -> int:  # type: ignore[override]
        return SPHERE if self.layout.is_round else FLAT

    @property
    def parts(self) -> None:  # type: ignore[override]
        return None

    @property
    def settings(self) -> Any:
        return ["numbers", *super().settings]

    def read(self, index: int) -> np.ndarray:
        (name,) = self.headers[0].names.values()
        k, i = self._where[index]
        header, out = self.headers[k], self.layout.empty()
        with opened_together(header.paths, self.selection.group) as dataset:
            for stored, layers in self._layers(header, dataset):
                values, missing = self._component(header, dataset.variables[name], i, stored)
                known = np.ones_like(values) if missing is None else (~missing).astype(np.float32)
                values = np.where(known > 0.0, values, np.float32(0.0))
                if header.curvilinear is not None:  # known corners alone give an even node its value
                    even, lacking = header.curvilinear.resampled({EAST: values, NORTH: known}, missing)
                    values = even[EAST] / np.maximum(even[NORTH], np.float32(0.5))
                    known = (~lacking).astype(np.float32)
                self.layout.fill_numbers(out, layers, values, known)
        return out

    @property
    def named(self) -> tuple[str, str]:
        """The variable's name for readers, and its unit."""
        (name,) = self.headers[0].names.values()
        with opened_together(self.headers[0].paths, self.selection.group) as dataset:
            return name_and_unit(name, dataset.variables[name].attrs)


def name_and_unit(name: str, attributes: Mapping[str, Any]) -> tuple[str, str]:
    """Return what readers call a variable, and its unit as they know it."""
    called = text(attributes, "long_name") or text(attributes, "standard_name").replace("_", " ") or name
    called = called.lower() if called.isupper() and " " in called else called
    unit = text(attributes, "units")
    return called, SHOWN.get(unit.lower(), unit)

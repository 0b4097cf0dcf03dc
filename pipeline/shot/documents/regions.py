"""What a shot file says under `region`, and the region it becomes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar

from pydantic import Field, GetJsonSchemaHandler, PrivateAttr, ValidationInfo, model_validator
from pydantic_core import CoreSchema, PydanticCustomError

from pipeline.flow.mesh_region import ClosedSurface, MeshRegion
from pipeline.flow.regions import (
    FALLOFF_TYPES,
    BoxRegion,
    CapsuleRegion,
    CylinderRegion,
    FalloffType,
    HalfSpaceRegion,
    Region,
    SphereRegion,
)
from pipeline.mesh.io.read import read_mesh
from pipeline.shot.clock import Clock
from pipeline.shot.documents.curves import NotNegativeField, PlaceField, PositiveField, number, place
from pipeline.shot.documents.fields import Axis, Document, Positive, axis, exactly_one, one_of
from pipeline.shot.yaml.parse_context import Surroundings, told

HERE = [0.0, 0.0, 0.0]

SHAPES = ("sphere", "box", "half_space", "capsule", "cylinder", "mesh")


class SphereDocument(Document):
    centre: PlaceField = HERE
    radius: PositiveField

    def build(self, clock: Clock, **rim: Any) -> Region:
        return SphereRegion(place(self.centre, clock), number(self.radius, clock), **rim)


class BoxDocument(Document):
    """size: its sides along x, y and z"""

    centre: PlaceField = HERE
    size: Annotated[list[Positive], Field(min_length=3, max_length=3)]

    def build(self, clock: Clock, **rim: Any) -> Region:
        x, y, z = map(float, self.size)
        return BoxRegion(place(self.centre, clock), (x, y, z), **rim)


class HalfSpaceDocument(Document):
    """Everything below the plane through `centre`; `normal` points up from it."""

    centre: PlaceField = HERE
    normal: Axis = "y"

    def build(self, clock: Clock, **rim: Any) -> Region:
        return HalfSpaceRegion(place(self.centre, clock), axis(self.normal), **rim)


class RoundDocument(Document):
    """A piece of a line and what is within a radius of it."""

    axis: Axis = "y"
    centre: PlaceField = HERE
    length: PositiveField
    radius: PositiveField

    def measures(self, clock: Clock) -> dict[str, Any]:
        return {
            "axis": axis(self.axis),
            "centre": place(self.centre, clock),
            "length": number(self.length, clock),
            "radius": number(self.radius, clock),
        }


class CapsuleDocument(RoundDocument):
    def build(self, clock: Clock, **rim: Any) -> Region:
        return CapsuleRegion(**self.measures(clock), **rim)


class CylinderDocument(RoundDocument):
    def build(self, clock: Clock, **rim: Any) -> Region:
        return CylinderRegion(**self.measures(clock), **rim)


class MeshDocument(Document):
    """What the closed surface in a file holds; `mesh: stone.obj` is `mesh: {file: stone.obj}`."""

    file: str
    centre: PlaceField = HERE
    scale: PositiveField = 1.0

    _surface: ClosedSurface = PrivateAttr()

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        return {"file": value} if isinstance(value, str) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [handler(core), {"type": "string"}]}

    @model_validator(mode="after")
    def _closed(self, info: ValidationInfo) -> MeshDocument:
        path = Surroundings.of(info).file(self.file)
        self._surface = told(lambda: ClosedSurface.of(read_mesh(path), str(path)))
        return self

    def build(self, clock: Clock, **rim: Any) -> Region:
        return MeshRegion(self._surface, place(self.centre, clock), number(self.scale, clock), **rim)


class RegionDocument(Document):
    """Exactly one shape by its name, and how it ends."""

    model_config = exactly_one(*SHAPES)
    renamed: ClassVar[Mapping[str, str]] = {"fall": "falloff_type"}

    sphere: SphereDocument | None = None
    box: BoxDocument | None = None
    half_space: HalfSpaceDocument | None = None
    capsule: CapsuleDocument | None = None
    cylinder: CylinderDocument | None = None
    mesh: MeshDocument | None = None
    falloff: NotNegativeField = 0.0
    falloff_type: Annotated[str, one_of(FALLOFF_TYPES, "falloff type")] = "smooth"
    invert: bool = False

    @model_validator(mode="after")
    def _names_one(self) -> RegionDocument:
        named = [name for name in SHAPES if getattr(self, name) is not None]
        if len(named) != 1:
            raise PydanticCustomError(
                "one_shape",
                "a region is one of {shapes}, and this has {found}. Write one.",
                {"shapes": ", ".join(SHAPES), "found": " and ".join(named) or "none"},
            )
        return self

    def build(self, clock: Clock) -> Region:
        shape = next(shape for name in SHAPES if (shape := getattr(self, name)) is not None)
        falloff_type: FalloffType = self.falloff_type  # type: ignore[assignment]  # one of them, as its validator says
        region: Region = shape.build(
            clock, falloff=number(self.falloff, clock), falloff_type=falloff_type, invert=self.invert
        )
        return region

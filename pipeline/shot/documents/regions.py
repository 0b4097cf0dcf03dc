"""The entry `region` of a flow, and the region it becomes."""

from typing import Annotated, Any, ClassVar, Self

from pydantic import (
    BeforeValidator,
    Field,
    GetJsonSchemaHandler,
    PrivateAttr,
    ValidationInfo,
    model_validator,
)
from pydantic_core import CoreSchema

from pipeline.flow.regions import (
    FALLOFF_TYPES,
    BoxRegion,
    CapsuleRegion,
    CylinderRegion,
    FalloffType,
    HalfSpaceRegion,
    MeshRegion,
    Region,
    SphereRegion,
)
from pipeline.flow.triangle_tree import ClosedSurface
from pipeline.mesh.read import read_mesh
from pipeline.shot.clock import Clock
from pipeline.shot.documents.curves import NotNegativeField, PlaceField, PositiveField, number, place
from pipeline.shot.documents.fields import (
    ORIGIN,
    Axis,
    Document,
    Positive,
    axis,
    exactly_one,
    one_of,
    optional,
    require_three,
)
from pipeline.shot.yaml.validation import ParseContext, as_finding, bad_value

SHAPES = ("sphere", "box", "half_space", "capsule", "cylinder", "mesh")


class SphereDocument(Document):
    example = "{radius: 1}"

    centre: PlaceField = Field(ORIGIN, description="its middle (units)")
    radius: PositiveField = Field(description="its size (units)")

    def build(self, clock: Clock, **falloff: Any) -> Region:
        return SphereRegion(place(self.centre, clock), number(self.radius, clock), **falloff)


class BoxDocument(Document):
    example = "{size: [1, 1, 1]}"

    centre: PlaceField = Field(ORIGIN, description="its middle (units)")
    size: Annotated[list[Positive], BeforeValidator(require_three), Field(min_length=3, max_length=3)] = (
        Field(description="its sides along x, y and z (units)")
    )

    def build(self, clock: Clock, **falloff: Any) -> Region:
        x, y, z = map(float, self.size)
        return BoxRegion(place(self.centre, clock), (x, y, z), **falloff)


class HalfSpaceDocument(Document):
    centre: PlaceField = Field(ORIGIN, description="a point of its plane (units)")
    normal: Axis = Field("y", description="points up from the plane, and out: x, y, z or a vector")

    def build(self, clock: Clock, **falloff: Any) -> Region:
        return HalfSpaceRegion(place(self.centre, clock), axis(self.normal), **falloff)


class CapsuleDocument(Document):
    """A segment of a line with a radius."""

    region: ClassVar[type[CapsuleRegion | CylinderRegion]] = CapsuleRegion

    axis: Axis = Field("y", description="direction of its segment: x, y, z or a vector")
    centre: PlaceField = Field(ORIGIN, description="its middle (units)")
    length: PositiveField = Field(description="of its segment (units)")
    radius: PositiveField = Field(description="around the segment (units)")

    def build(self, clock: Clock, **falloff: Any) -> Region:
        return self.region(
            axis=axis(self.axis),
            centre=place(self.centre, clock),
            length=number(self.length, clock),
            radius=number(self.radius, clock),
            **falloff,
        )


class CylinderDocument(CapsuleDocument):
    region = CylinderRegion


class MeshDocument(Document):
    """The inside of the closed surface in a file; `mesh: stone.obj` is `mesh: {file: stone.obj}`."""

    file: str = Field(description="an OBJ, PLY, STL, OFF, GLB, FBX, DAE, 3MF or USD beside the shot file")
    centre: PlaceField = Field(ORIGIN, description="position of its origin (units)")
    scale: PositiveField = Field(1.0, description="factor on its coordinates")

    _surface: ClosedSurface = PrivateAttr()

    @model_validator(mode="before")
    @classmethod
    def _bare(cls, value: Any) -> Any:
        return {"file": value} if isinstance(value, str) else value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        return {"anyOf": [handler(core), {"type": "string"}]}

    @model_validator(mode="after")
    def _is_closed(self, info: ValidationInfo) -> Self:
        path = ParseContext.of(info).mesh(self.file)
        self._surface = as_finding(lambda: ClosedSurface.of(read_mesh(path), str(path)))
        return self

    def build(self, clock: Clock, **falloff: Any) -> Region:
        return MeshRegion(self._surface, place(self.centre, clock), number(self.scale, clock), **falloff)


class RegionDocument(Document):
    """Exactly one shape by its name, and its falloff."""

    example = "{sphere: {radius: 1}}"

    model_config = exactly_one(*SHAPES)
    sphere: SphereDocument | None = optional("all within a radius of a point")
    box: BoxDocument | None = optional("all within sides along x, y and z")
    half_space: HalfSpaceDocument | None = optional("all below a plane")
    capsule: CapsuleDocument | None = optional("all within a radius of a segment of a line; round ends")
    cylinder: CylinderDocument | None = optional("a capsule with flat ends")
    mesh: MeshDocument | None = optional("the inside of the closed surface in a file")
    falloff: NotNegativeField = Field(
        0.0, description="distance outside over which the weight falls to 0 (units)"
    )
    falloff_type: Annotated[str, one_of(FALLOFF_TYPES, "falloff type")] = Field(
        "smooth", description="profile of the falloff"
    )
    invert: bool = Field(False, description="the outside instead of the inside")

    @model_validator(mode="after")
    def _names_one(self) -> Self:
        named = [name for name in SHAPES if getattr(self, name) is not None]
        if len(named) != 1:
            names = " and ".join(named) or "none"
            raise bad_value(f"a region is one of {', '.join(SHAPES)}, and this has {names}. Write one.")
        return self

    def build(self, clock: Clock) -> Region:
        shape = next(shape for name in SHAPES if (shape := getattr(self, name)) is not None)
        falloff_type: FalloffType = self.falloff_type  # type: ignore[assignment]  # as its validator says
        return shape.build(
            clock, falloff=number(self.falloff, clock), falloff_type=falloff_type, invert=self.invert
        )

"""The entry `subjects` of a shot file: several subjects by name, each with its place, look and flows."""

from typing import Annotated

from pydantic import Field

from pipeline.shot.clock import Clock
from pipeline.shot.copies import MOST_COPIES, Copies
from pipeline.shot.documents.fields import ORIGIN, ByForm, Document, Triple, optional
from pipeline.shot.documents.flows import DASHES, FlowDocument
from pipeline.shot.documents.look import LookField
from pipeline.shot.documents.regions import RegionDocument
from pipeline.shot.documents.resampling import ResampleField
from pipeline.shot.documents.subject import (
    CloudDocument,
    ModelDocument,
    NetDocument,
    SolidDocument,
    subject_form,
)


class CopiesDocument(Document):
    """Copies of a subject at places in a region."""

    example = "{count: 12, region: {sphere: {radius: 2}}}"

    count: Annotated[int, Field(ge=1, le=MOST_COPIES)] = Field(description="how many there are")
    seed: Annotated[int, Field(ge=0)] = Field(0, description="another one scatters them differently")
    region: RegionDocument = Field(description="holds all of them whole in the first frame")

    def build(self, clock: Clock) -> Copies:
        return Copies(self.count, self.seed, self.region.build(clock))


class SubjectSettings(Document):
    """Names in an entry of `subjects`, besides those of its solid, model, cloud or net."""

    place: Triple = Field(ORIGIN, description="where its origin is before it moves (units)")
    copies: CopiesDocument | None = optional("copies of it, scattered in a region")
    look: LookField | None = optional("its material, by name or spelt out; by default the shot's")
    flows: Annotated[list[FlowDocument], DASHES] = Field(
        default_factory=list, description="what moves it after the flows of the shot, which move all subjects"
    )
    resample: ResampleField | None = optional("thresholds of its edges; by default those of the shot")


class SubjectOfSolidDocument(SubjectSettings, SolidDocument):
    """A solid among several subjects."""


class SubjectOfModelDocument(SubjectSettings, ModelDocument):
    """A model among several subjects."""


class SubjectOfCloudDocument(SubjectSettings, CloudDocument):
    """A cloud among several subjects."""


class SubjectOfNetDocument(SubjectSettings, NetDocument):
    """A net among several subjects."""


SubjectEntry = SubjectOfSolidDocument | SubjectOfModelDocument | SubjectOfCloudDocument | SubjectOfNetDocument

SubjectsField = dict[str, Annotated[SubjectEntry, ByForm(subject_form)]]

"""Velocity fields made of velocity fields."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.flow.velocity import Term, VelocityField


@dataclass(frozen=True)
class Sum(VelocityField):
    """Velocities added up, then integrated together: the order of the fields does not matter."""

    fields: tuple[VelocityField, ...]

    @property
    def terms(self) -> tuple[Term, ...]:
        return tuple(term for field in self.fields for term in field.terms)

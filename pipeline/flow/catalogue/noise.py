"""Turbulence by the curl of noise."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

from pipeline.flow.kernels import noise as kernels
from pipeline.flow.parameters import Number, ParameterDoc, Positive, ValueRange, number_at
from pipeline.flow.velocity import ExternalField
from pipeline.kernels import BlockKernel

RMS = 85.16306274927067
"""Root mean square of the kernel's curl: the integral over a cell of the squared factors of the 72
independent components of gradients, times their variance (128² − 1) / 12."""

GRADIENT = 11.5
"""The gradient's norm, in root mean square speeds per cell, that 1 of 10⁴ points exceeds."""


@dataclass(frozen=True)
class CurlNoise(ExternalField):
    """Turbulence that keeps volume: the velocity is the curl of a noise.

    With ψ three noises, each a smooth random function that changes from cell to cell of a lattice,

        velocity = Σ over octaves  ∇ × ψ(lacunarityᵏ x / size) · roughnessᵏ

    scaled to a root mean square speed of `strength`. It is gradient noise with a fade of degree seven and
    exact derivatives, so that the divergence is zero to rounding. In time the gradients rotate from one
    random draw to the next, `evolution` times a second; their strength is constant.

    The gradient bound is exceeded at about one of 10⁴ points: there a sub-step is less exact.

    Source: Bridson, Houriham & Nordenstam, *Curl-Noise for Procedural Fluid Flow*, SIGGRAPH 2007; Perlin,
    *Improving Noise*, SIGGRAPH 2002.
    """

    size: Annotated[Positive, ParameterDoc("of the largest eddies", "units")] = 1.0
    strength: Annotated[Number, ParameterDoc("root mean square speed", "units/s")] = 1.0
    octaves: Annotated[int, ValueRange(1, 12), ParameterDoc("how many sizes of eddies")] = 3
    roughness: Annotated[
        float, ValueRange(0, 1), ParameterDoc("speed of a size over that of the next larger")
    ] = 0.5
    lacunarity: Annotated[float, ValueRange(1, 8), ParameterDoc("a size over the next smaller")] = 2.0
    evolution: Annotated[float, ParameterDoc("how often the eddies are renewed", "1/s")] = 0.5
    seed: Annotated[int, ValueRange(0, 2**53), ParameterDoc("which turbulence")] = 0

    @property
    def block(self) -> BlockKernel:
        return kernels.curl_noise

    @cached_property
    def _share(self) -> float:
        """The speed of the first octave over that of all: independent speeds add up by their squares."""
        return float(sum(self.roughness ** (2 * k) for k in range(self.octaves)) ** -0.5)

    def numbers(self, time: float) -> tuple[float, ...]:
        frequency = 1.0 / number_at(self.size, time)
        speed = number_at(self.strength, time) * self._share / RMS
        shape = float(self.octaves), self.lacunarity, self.roughness, float(self.seed)
        return (frequency, speed, *shape, self.evolution * time)

    def cache_data(self, time: float) -> Any:
        return {"curl_noise": list(self.numbers(time))}

    def gradient_bound(self, time: float) -> float:
        factors = (self.roughness * self.lacunarity) ** 2
        octaves = float(sum(factors**k for k in range(self.octaves)) ** 0.5)
        first = abs(number_at(self.strength, time)) * self._share / number_at(self.size, time)
        return GRADIENT * first * octaves

"""Turbulence."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any

from pipeline.flow import _kernels_noise as kernels
from pipeline.flow.keyframes import Number, number_at
from pipeline.flow.parameters import Between, Positive, Sense
from pipeline.flow.velocity import External
from pipeline.kernels import BlockKernel

RMS = 85.16306274927067
"""Root mean square of the kernel's curl: the integral over a cell of the squares of what multiplies each of
the 72 independent parts of gradients, times their variance (128² − 1) / 12."""

STEEPEST = 11.5
"""Of the gradient's norm, in root mean square speeds per cell: 1 of 10⁴ places is steeper."""


@dataclass(frozen=True)
class CurlNoise(External):
    """Turbulence that keeps volume: the velocity is the curl of a noise.

    With ψ three noises, each a smooth random function that changes from cell to cell of a lattice,

        velocity = Σ over octaves  ∇ × ψ(lacunarityᵏ x / size) · roughnessᵏ

    scaled to a root mean square speed of `strength`. It is gradient noise with a fade of degree seven, whose
    derivatives are worked out exactly, so that the divergence is zero to rounding. In time the gradients turn
    from one draw of the dice to the next, `evolution` times a second; its strength is the same at all times.

    The steepness is exceeded at about one of 10⁴ places: there a sub-step is followed less closely.

    Source: Bridson, Houriham & Nordenstam, *Curl-Noise for Procedural Fluid Flow*, SIGGRAPH 2007; Perlin,
    *Improving Noise*, SIGGRAPH 2002.
    """

    size: Annotated[Positive, Sense("of the largest eddies", "units")] = 1.0
    strength: Annotated[Number, Sense("root mean square speed", "units/s")] = 1.0
    octaves: Annotated[int, Between(1, 12), Sense("how many sizes of eddies")] = 3
    roughness: Annotated[float, Between(0, 1), Sense("speed of a size over that of the next larger")] = 0.5
    lacunarity: Annotated[float, Between(1, 8), Sense("a size over the next smaller")] = 2.0
    evolution: Annotated[float, Sense("how often the eddies are new ones", "1/s")] = 0.5
    seed: Annotated[int, Between(0, 2**53), Sense("which turbulence")] = 0

    @property
    def block(self) -> BlockKernel:
        return kernels.curl_noise

    @cached_property
    def _share(self) -> float:
        """Speed of the first octave over that of all: independent speeds add up by their squares."""
        return float(sum(self.roughness ** (2 * k) for k in range(self.octaves)) ** -0.5)

    def numbers(self, time: float) -> tuple[float, ...]:
        frequency, speed = (
            1.0 / number_at(self.size, time),
            number_at(self.strength, time) * self._share / RMS,
        )
        shape = float(self.octaves), self.lacunarity, self.roughness, float(self.seed)
        return (frequency, speed, *shape, self.evolution * time)

    def identity(self, time: float) -> Any:
        return {"curl_noise": list(self.numbers(time))}

    def gradient_bound(self, time: float) -> float:
        factors = (self.roughness * self.lacunarity) ** 2
        octaves = float(sum(factors**k for k in range(self.octaves)) ** 0.5)
        first = abs(number_at(self.strength, time)) * self._share / number_at(self.size, time)
        return STEEPEST * first * octaves

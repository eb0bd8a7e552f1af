"""The equations of B and D, the motions P(1,1,1): (16.10) to (16.13) of docs/proofs.md, and the margins of stability.

Z₁ = ε sin φ and Z₂ = ε cos φ, where φ is the phase of the forcing half-way between the impact on Σ⁺ and that on Σ⁻.
"""

from .intervals import PI, Interval, Jet, contact_force_enclosure


class TwoImpactTerms:
    """Terms of (16.10) to (16.13), docs/proofs.md: s, δ, a = e^(−δs), b = e^(−δ(1−s)), E = e^(−δ), sin πs, cos πs."""

    def __init__(self, s: Jet, d: Jet) -> None:
        self.s, self.d = s, d
        self.a, self.b, self.end = (d * s).exp_of_negative(), (d * (1 - s)).exp_of_negative(), d.exp_of_negative()
        self.sine, self.cosine = s.sine_and_cosine(1)


def two_impact_equations(t: TwoImpactTerms, beta: Interval) -> list[Jet]:
    """Return (16.10) and (16.11) of docs/proofs.md, each as the factor of Z₁, the factor of Z₂ and the right side."""
    late, lost = 1 - t.b, 1 - t.end
    both, k = (1 - t.a) * late, (1 - t.a) / (t.d * lost) * (4 * PI)
    first = both * t.cosine * -2, (t.b - t.a) * t.sine * 2, t.d * lost - both * 4
    second = t.sine * 2 - k * late * t.cosine, k * (1 + t.b) * t.sine, t.s * (4 * PI) + 2 * beta - k * late * 2
    return [*first, *second]


def speeds_and_epsilon_squared(t: TwoImpactTerms, z: list[Jet]) -> list[Jet]:
    """Return the speeds v after Σ⁺ and u after Σ⁻, and ε², from z = (Z₁, Z₂): (16.12), (16.13) of docs/proofs.md."""
    mean, apart, lost = t.cosine * z[0], t.sine * z[1], 1 - t.end
    p = ((1 - t.b) * (2 - mean) + (1 + t.b) * apart) / lost
    q = ((1 - t.a) * (2 - mean) - (1 + t.a) * apart) / lost
    v = (p * 2 + mean - apart - 2) * (2 * PI)
    u = (2 - mean - apart - q * 2) * (2 * PI)
    return [v, u, z[0] * z[0] + z[1] * z[1]]


def stability_margins(t: TwoImpactTerms, z: list[Jet]) -> list[Jet]:
    """Return the stability margins (1 + E − T) uv and (1 + E + T) uv of a P(1,1,1).

    z: Z₁ and Z₂ of the motion, the solution of (16.10) and (16.11) of docs/proofs.md. E is e^(−δ), and v and u are the
    speeds after Σ⁺ and after Σ⁻. T is the trace of the tangent map, a product of matrices: [[1, S], [0, 1 − δS]] of
    each flight of duration t, with S = (1 − e^(−δt))/δ, and [[−1, 0], [2g/w, −1]] of each impact that is reached with
    velocity w.

    Returns
    -------
    list[Jet]
        Both margins; the motion attracts if and only if both are positive.
    """
    v, u, _ = speeds_and_epsilon_squared(t, z)
    c0, s0, c1, s1 = t.cosine * z[1], t.sine * z[0], t.cosine * z[0], t.sine * z[1]
    top, bottom = contact_force_enclosure(t.d, c0 + s0, c1 - s1) * 2, contact_force_enclosure(t.d, c0 - s0, c1 + s1) * 2
    first, second = (1 - t.a) / t.d, (1 - t.b) / t.d
    # `down` is v times the tangent map of an impact on Σ⁺ followed by the flight to Σ⁻; `up` is u times the tangent map
    # of an impact on Σ⁻ followed by the flight to Σ⁺
    down = first * top - v, -(first * v), t.a * top, -(t.a * v)
    up = -(second * bottom) - u, -(second * u), -(t.b * bottom), -(t.b * u)
    trace, one = up[0] * down[0] + up[1] * down[2] + up[2] * down[1] + up[3] * down[3], (1 + t.end) * u * v
    return [one - trace, one + trace]

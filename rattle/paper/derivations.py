"""The derivations behind the findings on section 3.1.1 and (4.1), as Markdown."""

from rattle.paper.chaos import IMPACTS, WATCHED

DERIVATIONS = """\
### Low-speed bouncing: (3.6) to (3.13)

A flight leaves Φ = β at t* with Φ' = −v. Let h = t − t*, S = sin 2πt*, K = cos 2πt*. The equation of motion (2.3)
and its derivative give, at t*,

    a = Φ''  = δv + 4πδ − 4π²ε K − 2πδε S
    j = Φ''' = −δ²v − 4πδ² + 2πε (δ² + 4π²) S

    Φ  = β − v h + a h²/2 + j h³/6 + …          (3.6) is right: it stops before j
    Φ' = −v + a h + j h²/2 + …                  (3.7) is right

In the paper's notation f = 2j (3.9) and g = a² (3.10). Both are right.

The next impact, Φ = β with h ≠ 0, solves v = a h/2 + j h²/6 + …, so

    h = 2v/a − (4j/3a³) v² + …

(3.8) is the first term: h = 2v/(δv − 2πδε S + 4πδ − 4π²ε K). To this order that is right, but it must not be put
into (3.7), where the second term counts. The first one alone gives Φ' = v + (2j/a²) v² = v + (f/g) v², as printed.
With both, the second term adds a · (−4j/3a³) v² = −(4j/3a²) v², and

    Φ'(t̄) = −v + 2v − (4j/3a²) v² + (2j/a²) v² + … = v + (2j/3a²) v² + O(v³) = v + (f/3g) v² + O(v³).

The shorter way: eliminate a h between Φ = β and Φ', which leaves Φ' = v + j h²/6 + O(v³). The quadratic truncation
keeps j h²/2 and drops the −j h²/3 that the cubic term of Φ contributes.

Many small bounces: v changes by (2j/3a²) v² in a time 2v/a, so d ln v/dt = j/3a. As v → 0, a is the contact force
g(t) = 4πδ − 4π²ε cos 2πt − 2πδε sin 2πt, and j = g' − δg. So

    d ln v/dt = (g'/g − δ)/3,       v³ e^(δt)/g(t) = const,       v falls by e^(−δ/3) per forcing period.

The printed factor would make it d ln v/dt = g'/g − δ, so v e^(δt)/g(t) constant and e^(−δ) per period. This assumes
g > 0 at all phases: below the quiet limit ε = 2δ/√(4π² + δ²). Gains and losses cancel over a period except for the
damping, so what the paper found in simulations, a loss on average, is exact and not slight.

The extremes of f over the phase, f = 2(−δ²(v + 4π) + 2πε (δ² + 4π²) S), are

    f_min, f_max = 2 (−δ²(v + 4π) ∓ 2πε (δ² + 4π²)),       f_max > 0  ⇔  ε > δ²(v + 4π)/(2π(δ² + 4π²)).

### Existence of A and C: (4.1)

With Φ = c₁ + c₂ e^(−δt) + ε cos 2πt + 4πt from t* to t* + 1 and Φ = β at both ends, c = c₂ e^(−δt*) is 4π/(1 − E),
E = e^(−δ). Φ' is −v at the start and v at the end:

    −v = −δc − 2πε S + 4π,        v = −δcE − 2πε S + 4π.

Their difference gives 2v = δc(1 − E) = 4πδ, so v = 2πδ. Their sum gives ε S = 2 − δ(1 + E)/(1 − E) = 2 − δ
coth(δ/2), which is negative; |S| ≤ 1 is ε ≥ δ coth(δ/2) − 2 = |2 − δ coth(δ/2)|.

### The flip of C (PDC)

The tangent map of that flight has determinant E and trace 1 + E − 4π(1 − E) ε K/δ², with ε K = ±√(ε² − (ε S)²):
minus at A, plus at C. A multiplier is −1 where the trace is −1 − E, that is ε K = δ² coth(δ/2)/2π, so

    ε² = (δ coth(δ/2) − 2)² + (δ² coth(δ/2)/2π)².
"""

NOT_HELD = """\
The text at hand was extracted from the PDF, which loses primes, bars and perhaps more. Not held against the paper:
the absolute value missing in (4.1), all signs of the denominator of (3.8) reversed, the exponent missing in 4π² of
(3.13). The factor 3 is no such loss: it is missing in a formula whose terms all follow from (3.7) to (3.10) as
printed.
"""

NOT_CHECKED = f"""\
The stable and unstable manifolds of Figure 6, and that the homoclinic tangency of the crisis is born in COD22
(which the paper calls preliminary). The basins of Figure 4 are compared by their shares and labels, not cell by
cell. An end of chaos is an interval: {WATCHED} trajectories on the chaotic set were watched for {IMPACTS:,} impacts
each. At its upper end some left, so the set is no attractor there. At its lower end none did; a set that leaks so
slowly cannot be told from an attractor, so the end may lie below the interval by the little that this takes.
Attractors with a basin smaller than a few samples of 4096 are not seen.
"""

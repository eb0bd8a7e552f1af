"""Basin fractions of the paper's Figure 4 (δ = 0.6), known from elsewhere, and how an attractor is named there."""

# 100 × 100 cell centres by a separate program: quiet, chaotic, or (m, n₊, n₋).
KNOWN = {
    0.056: {"quiet": 1.0},
    0.0615: {"quiet": 0.898, (1, 1, 0): 0.102},
    0.078: {"quiet": 0.780, (1, 1, 0): 0.189, (2, 2, 2): 0.031},
    0.089: {"quiet": 0.733, (4, 4, 2): 0.085, (8, 8, 6): 0.082, (1, 1, 0): 0.073, (2, 2, 1): 0.021, (5, 5, 2): 0.006},
    0.1: {"quiet": 0.719, "chaotic": 0.249, (1, 1, 0): 0.032},
}


def label(attractor):
    return (attractor.m, attractor.n_plus, attractor.n_minus) if attractor.kind == "periodic" else attractor.kind

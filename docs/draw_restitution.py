"""Draw the pictures of docs/restitution.md and print its numbers: `make restitution`, a quarter of an hour of one core.

Planes that are computed once are kept in the directory that is given, so that pictures can be drawn again at once.
"""

from __future__ import annotations

import sys
from dataclasses import fields
from pathlib import Path

import numpy as np

from rattle import inelastic
from rattle.attractors.samples import Outcome
from rattle.attractors.speeds import SampleSpec
from rattle.attractors.table import AttractorTable
from rattle.flight.forcing import DRIFT
from rattle.inelastic.orbits.closed_form import departure_speed
from rattle.models import Inelastic
from rattle.plot import RestitutionPlane, codimension_two_figure, draw_restitution_figure, restitution_plane, save

IMAGES = Path(__file__).parent / "images"
RESTITUTIONS = (1.0, 0.98, 0.95, 0.9, 0.8)
DELTA, EPSILON, COUNT = np.linspace(0.4, 1.0, 81), np.linspace(0.005, 0.3, 60), 64
BETA = 0.6
WINDOW = {"delta": (0.3, 1.0), "epsilon": (0.0, 0.8)}
LOCAL = 256  # samples around C, in a box of this half-width in phase and speed
PHASE, SPEED = 0.03, 0.4
LINE = np.linspace(0.05, 0.18, 131)  # of ε, at δ = 0.6


def kept_plane(restitution: float, directory: Path) -> RestitutionPlane:
    """Return a plane, computed only where it is not kept."""
    path = directory / f"plane_{restitution:g}.npz"
    names = [each.name for each in fields(AttractorTable)]
    if not path.exists():
        plane = restitution_plane(restitution, DELTA, EPSILON, BETA, COUNT)
        np.savez_compressed(path, **{name: getattr(plane.table, name) for name in names})
    with np.load(path) as stored:
        table = AttractorTable(**{name: stored[name] for name in names})
    return RestitutionPlane(restitution, BETA, DELTA, EPSILON, table, COUNT)


def tell_plane(plane: RestitutionPlane) -> None:
    """Print a row of the table of shares."""
    chaos, quiet = plane.fraction_of(Outcome.CHAOTIC), plane.fraction_of(Outcome.QUIET)
    limit = np.array([inelastic.quiet_limit(delta, DRIFT) for delta in plane.delta])
    above = plane.epsilon[:, None] > limit
    some, alone = chaos > 0, plane.contact_fraction > 0
    strong = np.nanmax(plane.exponent)
    print(
        f"| {plane.restitution:g} | {quiet.mean():.3f} | {(quiet == 1).mean():.3f} | {some.mean():.3f} | "
        f"{some[~above].mean():.3f} | {some[above].mean():.3f} | {(chaos == 1).mean():.3f} | {alone.mean():.3f} | "
        f"{plane.fraction_of(Outcome.UNDECIDED).mean():.4f} | {strong:.2f} |"
    )


def around_c(model: Inelastic, delta: float, epsilon: np.ndarray, tau: float, v: float) -> AttractorTable:
    """Return what attracts states beside the C that grazes."""
    sample = SampleSpec(LOCAL, v_max=v + SPEED, tau=(tau - PHASE, tau + PHASE), v_min=v - SPEED)
    return model.attractors_of(np.full(epsilon.size, delta), epsilon, sample)


def tell_robust_chaos(restitution: float) -> None:
    """Print where chaos begins and ends between COD23 and COD22, and whether anything else is seen there."""
    model = Inelastic(BETA, restitution)
    points = {each.name: each for each in model.codimension_two()}
    delta = 0.5 * (points["COD23"].delta + points["COD22"].delta)
    graze = inelastic.trace("G1", BETA, restitution, **WINDOW)
    (begin,) = graze.at(delta=delta)
    near = int(np.argmin(np.abs(graze.delta - delta)))
    tau, v = float(graze.tau[near]), departure_speed(delta, restitution, DRIFT)
    low, high = begin * (1 + 1e-5), begin * 1.1
    for _ in range(14):  # the last ε at which chaos is found
        middle = 0.5 * (low + high)
        found = around_c(model, delta, np.array([middle]), tau, v)
        low, high = (middle, high) if (found.kind == Outcome.CHAOTIC).any() else (low, middle)
    inside = begin + (low - begin) * np.linspace(0.01, 0.95, 40)
    found = around_c(model, delta, inside, tau, v)
    chaotic = found.kind == Outcome.CHAOTIC
    other = (found.kind == Outcome.PERIODIC) & (found.samples > 0)
    born = inelastic.epsilon_of_saddle_node(delta, restitution, DRIFT)
    print(
        f"| {restitution:g} | {delta:.5f} | {born:.6f} | {begin:.6f} | {low:.6f} | "
        f"{np.unique(found.cell[chaotic]).size} | "
        f"{np.unique(found.cell[other]).size} | {found.first[chaotic].min():.2f} to {found.first[chaotic].max():.2f} | "
        f"{distance_from_a(model, delta, 0.5 * (begin + low)):.4f}, {distance_from_a(model, delta, low):.4f} |",
        flush=True,
    )


def distance_from_a(model: Inelastic, delta: float, epsilon: float) -> float:
    """Return how close a chaotic motion comes to A, in (τ, v), in 20,000 returns."""
    gear = model.gear(delta, epsilon)
    (a,) = (each for each in gear.orbits() if each.name == "A")
    table = model.attractors_of(np.array([delta]), np.array([epsilon]), SampleSpec(2048))
    chaotic = np.flatnonzero(table.kind == Outcome.CHAOTIC)
    if not chaotic.size:
        return float("nan")
    tau, v = float(table.tau[chaotic[0]]), float(table.v[chaotic[0]])
    nearest = np.inf
    for _ in range(20_000):
        step = gear.impact(tau, v)
        tau, v = step.tau, step.v
        nearest = min(nearest, float(np.hypot((tau - a.tau + 0.5) % 1.0 - 0.5, v - a.v)))
    return nearest


def tell_line(restitution: float) -> None:
    """Print where chaos is found at δ = 0.6 below the quiet limit."""
    table = Inelastic(BETA, restitution).attractors_of(np.full(LINE.size, 0.6), LINE, SampleSpec(256))
    chaotic = np.unique(table.cell[table.kind == Outcome.CHAOTIC])
    at = LINE[chaotic]
    where = f"{at.min():.3f} to {at.max():.3f}" if at.size else "nowhere"
    print(f"| {restitution:g} | {at.size} of {LINE.size} | {where} |", flush=True)


def main() -> None:
    """Compute, draw and print."""
    directory = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    planes = [kept_plane(r, directory) for r in RESTITUTIONS]
    save(draw_restitution_figure(planes).figure, IMAGES / "restitution.png", dpi=110)
    save(codimension_two_figure(BETA).figure, IMAGES / "restitution_points.png", dpi=110)
    for plane in planes:
        tell_plane(plane)
    for r in RESTITUTIONS:
        tell_line(r)
    for name in ("COD20", "COD21", "COD23", "COD22"):
        curve = inelastic.follow_codimension_two(name, BETA)
        row = [curve.at(r) for r in (1.0, 0.98, 0.95, 0.9, 0.8, 0.5)]
        print(name, *(f"({delta:.5f}, {epsilon:.5f})" for delta, epsilon in row), curve.end, curve.residual.max())
    for r in (*RESTITUTIONS, 0.7):
        tell_robust_chaos(r)


if __name__ == "__main__":
    main()

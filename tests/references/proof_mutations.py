"""Mutations of the finder's signs and bounds, and which test catches each.

    python tests/references/proof_mutations.py [NAME …]

runs the tests of proofs with each of them in place, or with those that are named, and writes the first that fails to
tests/reference/proof_mutations.json; a mutation that none catches is written as null. As a plugin of pytest it puts the
mutation in place that the environment names: the library's other modules, and their compiled kernels, stay as they are.
"""

import importlib.abc
import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
RESULT = ROOT / "tests" / "reference" / "proof_mutations.json"
TESTS = ("lemmas", "motions", "false_claims")
NAMED = "PROOF_MUTATION"

#: What is wrong: (file of rattle/proof, what stands there once, what the mutation puts there).
MUTATIONS = {
    "a box of half its radius": ("balls", "arb(0, 1) * ball(radius)", "arb(0, 1) * ball(radius) / 2"),
    "the operator with the wrong sign of R": ("krawczyk", "column_vector(box) - step", "column_vector(box) + step"),
    "no limit to how far Newton moves": ("krawczyk", "if not moved < MOST_MOVED", "if not moved < 1.0"),
    "a box that may be mapped beyond itself": (
        "krawczyk",
        "if all(abs(each) < limit",
        "if all(abs(each) < 10**6 * limit",
    ),
    "the velocity of a flight with a wrong sign": (
        "flights",
        "point.drift - point.velocity_amplitude * sine - ",
        "point.drift + point.velocity_amplitude * sine - ",
    ),
    "the height of a flight with a wrong sign": ("flights", "(kept - 1) / point.delta", "(1 - kept) / point.delta"),
    "the force never changes sign": ("flights", "if share > 1:", "if share > 0:"),
    "the arc begins where it ends": (
        "flights",
        "return middle - half, middle + half",
        "return middle + half, middle + half",
    ),
    "the arc is not looked at": ("flights", "if not edge + number < flight.t0:", "if edge + number < flight.t0:"),
    "minima are compared with the upper wall": (
        "flights",
        "height > below if turn == UP else height < above",
        "height < above if turn == UP else height > below",
    ),
    "maxima are not compared": (
        "flights",
        "height > below if turn == UP else height < above",
        "height > below if turn == UP else True",
    ),
    "the gap is on the other side": ("flights", "-flight.point.beta * (1 + wall)", "-flight.point.beta * (3 + wall)"),
    "flights from behind a wall": (
        "flights",
        "if proved_sign(flight.w0) != -wall or proved_sign(flight.w1) != target:",
        "if proved_sign(flight.w0) != -wall and proved_sign(flight.w1) != target:",
    ),
    "an extremum without its bound": ("flights", "height + arb(0, 1) * length * ", "height + arb(0) * length * "),
    "a bound of an extremum without damping": ("flights", " * (flight.point.delta * length).exp() * slope", " * slope"),
    "a turn taken for none": ("flights", "        if after != before:", "        if after < before:"),
    "derivatives of a flight with a wrong sign": ("flights", "w0_t1=-pull * w1", "w0_t1=pull * w1"),
    "a tangent map that forgets its end": ("impacting", "each.w1_t0 + each.w1_t1 * t_t", "each.w1_t0"),
    "a flip taken for stability": ("finder", "if abs(trace) < 1 + determinant:", "if trace < 1 + determinant:"),
    "saddles within the unit circle": ("finder", "if abs(trace) > 1 + determinant", "if abs(trace) > determinant"),
    "half a motion's period": ("finder", "abs(b - a - m // parts) > 0", "abs(b - a) > 0"),
    "enclosures rounded inwards": ("finder", "(low // unit - 1) * unit", "(low // unit + 2) * unit"),
    "speeds that nobody compares": (
        "finder",
        "if not moved < MOST_MOVED * max(1.0, *departures):",
        "if not moved < 1.0:",
    ),
    "a steady motion with a wrong sign": (
        "stiff",
        "self.mean_steady_penetration + a * cosine + b * sine",
        "self.mean_steady_penetration + a * cosine - b * sine",
    ),
    "a contact that turns unseen": ("stiff", "if not (slope > 0 or slope < 0):", "if slope > 0 and slope < 0:"),
    "a contact without its mean value bound": (
        "stiff",
        "if not y + wall * slope * (part - middle) > 0:",
        "if not y > 0:",
    ),
    "motions of one impact before they are born": (
        "areas/one_impact",
        "if upper_end(piece.epsilon) < lower_end(y):",
        "if lower_end(piece.epsilon) < lower_end(y):",
    ),
    "a flight that is looked at for the wrong amplitude": (
        "areas/one_impact",
        "if not height_over(x_high) > -2 * piece.beta:",
        "if not height_over(x_low) > -2 * piece.beta:",
    ),
    "a flip that only part of a block has passed": (
        "areas/one_impact",
        "True if upper_end(x) < lower_end(limit)",
        "True if lower_end(x) < lower_end(limit)",
    ),
    "a mean value without its derivative": ("areas/piece", " + function(arb_series([at, 1]))[1] * (at - middle)", ""),
    "cells that are empty for a part of a block": (
        "areas/two_impacts",
        "self.epsilon_squared < low or",
        "self.epsilon_squared < high or",
    ),
    "a speed after two impacts with a wrong sign": ("areas/two_impacts", "+ 2 * PI() * y\n", "- 2 * PI() * y\n"),
    "multipliers of two impacts with a wrong sign": (
        "areas/two_impacts",
        "force_plus * u - force_minus",
        "force_plus * u + force_minus",
    ),
    "motions that leave Σ⁻ the wrong way": (
        "areas/two_impacts",
        "sigma_minus = self.solution.over_cell[3] > 0",
        "sigma_minus = True",
    ),
    "a graze that is compared with the wrong edge": (
        "areas/two_impacts",
        "self.bound_square_plus_speed(-1) < -high",
        "self.bound_square_plus_speed(-1) < -low",
    ),
    "one motion counted for none": ("areas/two_impacts", "return sides == [", "return sides != ["),
    "quiet beyond its limit": (
        "areas/quiet_enclosure",
        "True if piece.epsilon < share",
        "True if piece.epsilon.lower() < share",
    ),
    "bounces that grow, called shrinking": ("areas/capture", "ratio**3 - third / 3", "ratio**3 + third / 3"),
    "a condition with a wrong sign": (
        "bifurcations/codimension_two",
        "- impacts) - 4 * PI() * x",
        "- impacts) + 4 * PI() * x",
    ),
}


class Mutant(importlib.abc.SourceLoader, importlib.abc.MetaPathFinder):
    """Loads one module of rattle.proof with a mutation in it."""

    def __init__(self, file: str, old: str, new: str) -> None:
        self.name, self.path = f"rattle.proof.{file.replace('/', '.')}", str(ROOT / "rattle" / "proof" / f"{file}.py")
        text = Path(self.path).read_text()
        assert text.count(old) == 1, f"{old!r} is in {file}.py {text.count(old)} times"
        self.text = text.replace(old, new)

    def find_spec(self, name, path, target=None):  # noqa: ARG002
        return importlib.util.spec_from_loader(name, self) if name == self.name else None

    def get_filename(self, _name):
        return self.path

    def get_data(self, _path):
        return self.text.encode()


def caught_by(name: str) -> str | None:
    """The first test that fails with a mutation."""
    of_areas = MUTATIONS[name][0].startswith("areas/")
    tests = [f"tests/oracles/proof/test_proof_{each}.py" for each in (("areas",) if of_areas else TESTS)]
    command = [sys.executable, "-m", "pytest", "-p", "proof_mutations", "-x", "-q", "-n0", "-p", "no:cacheprovider"]
    environment = os.environ | {NAMED: name, "PYTHONPATH": str(Path(__file__).parent), "PYTHONDONTWRITEBYTECODE": "1"}
    said = subprocess.run([*command, *tests], cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    if said.returncode == 0:
        return None
    failed = re.search(r"^(?:FAILED|ERROR) \S*test_proof_(\S+)", said.stdout, re.MULTILINE)
    if not failed:
        raise SystemExit(said.stdout[-3000:] + said.stderr[-3000:])
    return failed[1]


def main(names: list[str]) -> None:
    """Try these or all, and write who catches them."""
    found = json.loads(RESULT.read_text()) if names else {}
    for name in names or MUTATIONS:
        found[name] = caught_by(name)
        print(f"{name}: {found[name]}", flush=True)
    RESULT.write_text(json.dumps(found, indent=1) + "\n")


if NAMED in os.environ:
    sys.meta_path.insert(0, Mutant(*MUTATIONS[os.environ[NAMED]]))

if __name__ == "__main__":
    main(sys.argv[1:])

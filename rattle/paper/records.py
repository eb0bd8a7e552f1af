"""Statements of the paper beside computed values, and the rule that decides whether they agree.

A number agrees if it lies within half a unit of the last digit that the paper gives; where the paper writes ≈, within
one unit, because ≈ does not say that the last digit was rounded and not cut. An interval agrees only as a whole.
"""

from dataclasses import dataclass
from decimal import Decimal

ROUNDING = 1e-12  # the paper's decimals are not binary fractions

AGREES, OFF, UNDECIDED = "agrees", "off", "undecided"
HOLDS, FAILS = "holds", "fails"


@dataclass(frozen=True)
class Number:
    """One number that the paper states, as it writes it, and the computed one: a value, or the interval that is left.

    where: figure or section. finding: key of the finding that says why the two differ, "" if they should agree.
    """

    where: str
    what: str
    paper: str
    computed: float | tuple[float, float]
    finding: str = ""

    @property
    def interval(self) -> tuple[float, float]:
        """Return both ends of what was computed."""
        return self.computed if isinstance(self.computed, tuple) else (self.computed, self.computed)

    @property
    def stated(self) -> Decimal:
        """The paper's digits."""
        return Decimal(self.paper.removeprefix("≈").strip())

    @property
    def tolerance(self) -> float:
        """Largest difference that agrees: half a unit of the last digit, with ≈ one unit."""
        unit = 10.0 ** int(self.stated.as_tuple().exponent)
        return unit if self.paper.startswith("≈") else unit / 2

    @property
    def difference(self) -> float:
        """Computed (of an interval its middle) less stated."""
        return sum(self.interval) / 2 - float(self.stated)

    @property
    def verdict(self) -> str:
        """AGREES, OFF, or UNDECIDED where only part of the interval agrees."""
        low, high = (end - float(self.stated) for end in self.interval)
        reach = self.tolerance + ROUNDING
        if -reach <= low and high <= reach:
            return AGREES
        return OFF if low > reach or high < -reach or low != low or high != high else UNDECIDED

    @property
    def as_expected(self) -> bool:
        """False if it is off and no finding takes that up, or if it agrees though a finding says that it does not."""
        return self.verdict == (OFF if self.finding else AGREES)


@dataclass(frozen=True)
class Statement:
    """One thing that the paper says without a number, the evidence in words, and whether that bears it out."""

    where: str
    says: str
    computed: str
    holds: bool

    @property
    def verdict(self) -> str:
        """HOLDS or FAILS."""
        return HOLDS if self.holds else FAILS

    @property
    def as_expected(self) -> bool:
        """A statement that fails belongs among the findings."""
        return self.holds


@dataclass(frozen=True)
class FindingEvidence:
    """One computed fact in support of a finding, and whether the computation still shows it."""

    shows: str
    holds: bool


@dataclass(frozen=True)
class Finding:
    """Finding: a wrong or incomplete statement of the paper, the right one, and computed evidence.

    key: the name by which a `Number` refers to it.
    """

    key: str
    title: str
    paper: str
    instead: str
    evidence: tuple[FindingEvidence, ...]

    @property
    def as_expected(self) -> bool:
        """True while all of its evidence holds."""
        return all(one.holds for one in self.evidence)


@dataclass(frozen=True)
class Report:
    """Numbers, statements, and findings in the order of their numbers from `first`, 1 in a whole report."""

    numbers: tuple[Number, ...]
    statements: tuple[Statement, ...]
    findings: tuple[Finding, ...]
    first: int = 1

    def number_of(self, key: str) -> int:
        """Return the number of the finding of this key."""
        return [x.key for x in self.findings].index(key) + self.first

    @property
    def summary(self) -> str:
        """How many numbers, statements and findings there are, and how many are as they should be, in a line."""
        counts = (
            (sum(x.verdict == AGREES for x in self.numbers), self.numbers, "numbers agree"),
            (sum(x.finding != "" and x.as_expected for x in self.numbers), self.numbers, "are off as findings say"),
            (sum(x.holds for x in self.statements), self.statements, "statements hold"),
            (sum(x.as_expected for x in self.findings), self.findings, "findings are borne out"),
        )
        return ", ".join(f"{count} of {len(every)} {words}" for count, every, words in counts if every)

    @property
    def unexpected(self) -> tuple[str, ...]:
        """Deviations without a finding that explains them, and findings whose evidence is not borne out."""
        numbers = (x.what for x in self.numbers if not x.as_expected)
        statements = (x.says for x in self.statements if not x.as_expected)
        numbered = enumerate(self.findings, self.first)
        findings = (f"finding {i}: {x.title}" for i, x in numbered if not x.as_expected)
        return (*numbers, *statements, *findings)

"""Records of the check: numbers, statements and findings, and the rule that decides whether a number agrees.

A number agrees if the computed value is within half a unit of the last digit that the paper gives. Where the paper
writes ≈, the computed value must be within one unit, because the last digit may have been cut off and not rounded. A
computed interval agrees only if all its values agree.
"""

from dataclasses import dataclass
from decimal import Decimal

#: Added to each tolerance, because the paper's decimals are not exact in binary.
ROUNDING = 1e-12

AGREES, OFF, UNDECIDED = "agrees", "off", "undecided"
HOLDS, FAILS = "holds", "fails"


@dataclass(frozen=True)
class StatedNumber:
    """A number that the paper states, and its computed value.

    where: the paper's figure or section. what: the quantity. paper: the number as the paper prints it.
    computed: the computed value, or both ends of an interval that contains this value.
    finding: the key of the finding that explains why printed and computed number differ, "" if they should agree.
    """

    where: str
    what: str
    paper: str
    computed: float | tuple[float, float]
    finding: str = ""

    @property
    def interval(self) -> tuple[float, float]:
        """Both ends of the computed interval; if the computation gave a single value, this value twice."""
        return self.computed if isinstance(self.computed, tuple) else (self.computed, self.computed)

    @property
    def printed_value(self) -> Decimal:
        """The number that the paper prints, without ≈."""
        return Decimal(self.paper.removeprefix("≈").strip())

    @property
    def tolerance(self) -> float:
        """Largest difference at which numbers agree: half a unit of the paper's last digit, a whole unit after ≈."""
        unit = 10.0 ** int(self.printed_value.as_tuple().exponent)
        return unit if self.paper.startswith("≈") else unit / 2

    @property
    def difference(self) -> float:
        """The computed value, or the middle of the interval, minus the number that the paper prints."""
        return sum(self.interval) / 2 - float(self.printed_value)

    @property
    def verdict(self) -> str:
        """AGREES or OFF; UNDECIDED if only a part of the computed interval agrees."""
        low, high = (end - float(self.printed_value) for end in self.interval)
        reach = self.tolerance + ROUNDING
        if -reach <= low and high <= reach:
            return AGREES
        return OFF if low > reach or high < -reach or low != low or high != high else UNDECIDED

    @property
    def is_as_expected(self) -> bool:
        """True if the verdict is AGREES and there is no finding, or OFF and there is a finding that explains it."""
        return self.verdict == (OFF if self.finding else AGREES)


@dataclass(frozen=True)
class Statement:
    """A statement that the paper makes in words; a number that it states is a `StatedNumber`.

    where: the paper's figure or section. says: the statement. computed: the computed evidence in words.
    holds: whether the evidence supports the statement.
    """

    where: str
    says: str
    computed: str
    holds: bool

    @property
    def verdict(self) -> str:
        """HOLDS if the evidence supports the statement, else FAILS."""
        return HOLDS if self.holds else FAILS

    @property
    def is_as_expected(self) -> bool:
        """True if the statement holds. All are expected to hold: a wrong statement of the paper is in a `Finding`."""
        return self.holds


@dataclass(frozen=True)
class FindingEvidence:
    """A computed fact in support of a finding.

    shows: the fact in words, with numbers. holds: whether the computation confirms this fact.
    """

    shows: str
    holds: bool


@dataclass(frozen=True)
class Finding:
    """A wrong or incomplete statement of the paper, with its correction and computed evidence.

    key: the name by which a `StatedNumber` refers to the finding. title: one sentence.
    paper: what the paper states. instead: the correction. evidence: the computed facts.
    """

    key: str
    title: str
    paper: str
    instead: str
    evidence: tuple[FindingEvidence, ...]

    @property
    def is_as_expected(self) -> bool:
        """True if all of the evidence holds."""
        return all(one.holds for one in self.evidence)


@dataclass(frozen=True)
class Report:
    """The result of the check of the paper.

    first: the number of the first finding. It is 1, unless the report has a single finding chosen by its number.
    """

    numbers: tuple[StatedNumber, ...]
    statements: tuple[Statement, ...]
    findings: tuple[Finding, ...]
    first: int = 1

    def finding_number(self, key: str) -> int:
        """Return the number of the finding with this key."""
        return [x.key for x in self.findings].index(key) + self.first

    @property
    def summary(self) -> str:
        """One line of text: how many numbers agree or differ as findings say, how many statements and findings hold."""
        counts = (
            (sum(x.verdict == AGREES for x in self.numbers), self.numbers, "numbers agree"),
            (sum(x.finding != "" and x.is_as_expected for x in self.numbers), self.numbers, "are off as findings say"),
            (sum(x.holds for x in self.statements), self.statements, "statements hold"),
            (sum(x.is_as_expected for x in self.findings), self.findings, "findings are borne out"),
        )
        return ", ".join(f"{count} of {len(every)} {words}" for count, every, words in counts if every)

    @property
    def deviations(self) -> tuple[str, ...]:
        """Texts of the numbers, statements and findings that are not as expected, such as an unexplained deviation."""
        numbers = (x.what for x in self.numbers if not x.is_as_expected)
        statements = (x.says for x in self.statements if not x.is_as_expected)
        numbered = enumerate(self.findings, self.first)
        findings = (f"finding {i}: {x.title}" for i, x in numbered if not x.is_as_expected)
        return (*numbers, *statements, *findings)

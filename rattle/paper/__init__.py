"""Check the paper: every number and statement of Mason and Piiroinen (2009) beside its computed value.

With findings where it is wrong or incomplete.
"""

from rattle.paper.document import RULE, difference, markdown, value, verdict
from rattle.paper.records import Finding, FindingEvidence, Number, Report, Statement
from rattle.paper.report import one_finding, report

__all__ = [
    "RULE",
    "Finding",
    "FindingEvidence",
    "Number",
    "Report",
    "Statement",
    "difference",
    "markdown",
    "one_finding",
    "report",
    "value",
    "verdict",
]

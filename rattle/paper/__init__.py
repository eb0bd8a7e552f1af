"""Check the paper: compare each number and statement of Mason and Piiroinen (2009) with computed values.

A finding states where the paper is wrong or incomplete, with computed evidence.
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

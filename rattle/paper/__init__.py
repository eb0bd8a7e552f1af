"""Check the paper: compare each number and statement of Mason and Piiroinen (2009) with computed values.

A finding states where the paper is wrong or incomplete, with computed evidence.
"""

from rattle.paper.document import RULE, difference, format_computed, markdown, verdict
from rattle.paper.records import Finding, FindingEvidence, Report, StatedNumber, Statement
from rattle.paper.report import compute_finding, report

__all__ = [
    "RULE",
    "Finding",
    "FindingEvidence",
    "Report",
    "StatedNumber",
    "Statement",
    "compute_finding",
    "difference",
    "format_computed",
    "markdown",
    "report",
    "verdict",
]

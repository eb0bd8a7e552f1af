"""The paper, checked: every number and statement of Mason and Piiroinen (2009) beside what is computed, and where it is
wrong or incomplete.
"""

from rattle.paper.document import markdown
from rattle.paper.records import Evidence, Finding, Number, Report, Statement
from rattle.paper.report import one_finding, report

__all__ = ["Evidence", "Finding", "Number", "Report", "Statement", "markdown", "one_finding", "report"]

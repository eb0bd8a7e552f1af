"""What can go wrong with a survey, under one exception."""

from rattle import RattleError


class SurveyError(RattleError):
    """A survey that cannot be asked for, stored, run, opened or drawn; the message says what to do."""


class ClusterLostError(SurveyError):
    """The cluster went away during a run. The survey is whole: another cluster resumes it."""

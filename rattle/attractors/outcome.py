"""What ends a sample: one enumeration, for samples on their way, for tables of attractors, and inside kernels."""

from enum import IntEnum


class Outcome(IntEnum):
    """What has become of a sample; numba reads the members as constants.

    UNRESOLVED: it goes on. QUIET: it is certain to stay in contact with Σ⁺. PERIODIC: a stable orbit has captured it.
    CHAOTIC: it is on a chaotic attractor. UNDECIDED: nothing tells where it goes. RECURRENT: it has come back to where
    it was, and its orbit is looked for; only on the way. FAILED: it cannot be followed; a table counts it as undecided.

    Tables and stores hold the numbers from QUIET to UNDECIDED as kinds of attractors; `rattle.KINDS` has them in words.
    """

    UNRESOLVED = 0
    QUIET = 1
    PERIODIC = 2
    CHAOTIC = 3
    UNDECIDED = 4
    RECURRENT = 5
    FAILED = 6

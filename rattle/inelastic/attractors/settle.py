"""Follow samples of the inelastic gear until each is quiet, captured, recurs, or has made its impacts (compiled).

Sample by sample, as in `rattle.stiff.attractors.settle`. A motion with a contact phase recurs to the bit, since what
follows a release does not depend on what went before; its tangent map is 0, and Newton's method ends at once.
"""

import math

from rattle.attractors.chaos import BATCHES
from rattle.attractors.samples import ALIGNMENT, Outcome, begun, finish, looked, mark, top_speed
from rattle.flight.contact_phase import IN_CONTACT
from rattle.flight.first_impact import OK
from rattle.flight.law import speed_unit
from rattle.inelastic.map.cells import point_at
from rattle.inelastic.map.impact_map import step, step_tangent
from rattle.inelastic.map.runs import merged_runs
from rattle.numerics.compile import inline, kernel


@inline
def ended_with(code):
    """What a return that does not come back says of its sample."""
    return Outcome.QUIET if code == IN_CONTACT else Outcome.FAILED


@kernel
def settle(which, cells, samples, balls):
    """Follow the samples `which` until they end; a sample that makes all its returns is UNRESOLVED."""
    for j in range(which.size):
        k = which[j]
        point = point_at(samples.cell[k], cells)
        tau, v, n, total = samples.tau[k], samples.v[k], 0, 0.0
        unit = speed_unit(point.delta, point.epsilon, point.beta)
        reference = begun(tau, v)
        status, orbit, reference = looked(tau, v, n, k, reference, samples, balls, unit)
        while status == Outcome.UNRESOLVED and samples.impacts[k] + n < samples.limit[k]:
            code, tau, v, time, _below, _plus, _minus = step(tau, v, point)
            if code != OK:
                status = ended_with(code)
                break
            n, total = n + 1, total + time
            status, orbit, reference = looked(tau, v, n, k, reference, samples, balls, unit)
        finish(tau, v, n, total, k, status, orbit, samples)


@kernel
def measure(which, least, periods, cells, samples, balls, sums, footprints):
    """As `settle`, with a tangent vector, for at least so many returns and forcing periods (k,), or to the limit.

    sums[j, batch], zero before, gathers time, ln stretch and ln|det| of sample which[j] after ALIGNMENT returns,
    footprints[j] the boxes that it visits. Contact makes the stretch −∞, which no chaos has.
    """
    for j in range(which.size):
        k = which[j]
        point = point_at(samples.cell[k], cells)
        tau, v, n, x, y, total = samples.tau[k], samples.v[k], 0, 1.0, 0.0, 0.0
        unit = speed_unit(point.delta, point.epsilon, point.beta)
        most = float(samples.limit[k] - samples.impacts[k])
        reference = begun(tau, v)
        status, orbit, reference = looked(tau, v, n, k, reference, samples, balls, unit)
        while status == Outcome.UNRESOLVED:
            share = min((n - ALIGNMENT) / (least[j] - ALIGNMENT), total / periods[j])
            share = max(share, n / most)
            if share >= 1.0:
                break
            before = v
            code, tau, v, time, _below, j00, j01, j10, j11, log_det, _plus, _minus = step_tangent(tau, v, point)
            if code != OK:
                status = ended_with(code)
                break
            n, total = n + 1, total + time
            # in (t, v²/2), where the determinant is that of the impact law
            x, y = j00 * x + j01 / before * y, v * (j10 * x + j11 / before * y)
            size = math.hypot(x, y)
            if size > 0.0:
                x, y = x / size, y / size
            else:
                x, y = 1.0, 0.0
            if n > ALIGNMENT:
                row = sums[j, min(int(max(share, 0.0) * BATCHES), BATCHES - 1)]
                row[0] += time
                row[1] += math.log(size)
                row[2] += log_det
            mark(tau, v, top_speed(point.epsilon, unit), footprints[j])
            status, orbit, reference = looked(tau, v, n, k, reference, samples, balls, unit)
        finish(tau, v, n, total, k, status, orbit, samples)


@kernel
def label_contacts(grown, cells, orbits):
    """Enter the contact phases of the orbits of every cell from number grown[cell] on."""
    for cell in range(grown.size):
        for j in range(grown[cell], orbits.n[cell]):
            if orbits.first[cell, j] == -math.inf:
                point = point_at(cell, cells)
                found = merged_runs(orbits.tau[cell, j], orbits.v[cell, j], orbits.n_plus[cell, j], point)
                orbits.contacts[cell, j], orbits.merged[cell, j] = found

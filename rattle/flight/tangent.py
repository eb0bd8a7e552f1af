"""The tangent of one flight and of the impact at its end (compiled)."""

from rattle.flight.forcing import height_derivatives_by_departure_time
from rattle.flight.impact_law import determinant_of_impact, velocity_change_after_elastic_impact
from rattle.flight.law import second_derivative
from rattle.numerics.compile import inline


@inline
def flight_derivatives(lost, sin0, cos0, sin1, cos1, inverse_delta, epsilon):
    """Return ∂F/∂w₀, ∂F/∂t₀ and ∂F'/∂t₀ of a flight's height F at fixed flight time s.

    lost: 1 − e^(−δs). The derivative ∂F'/∂w₀ is not returned, because it is simply 1 − lost.

    Returns
    -------
    tuple of float
        The three derivatives.
    """
    f_w = lost * inverse_delta
    f_t, v_t = height_derivatives_by_departure_time(f_w, 1.0 - lost, sin0, cos0, sin1, cos1, epsilon)
    return f_w, f_t, v_t


@inline
def flight_tangent(w1, lost, sin1, cos1, flight):
    """Return the matrix ∂(t₁, w₁ after reflection)/∂(t₀, w₀) of one flight, as four numbers row by row.

    With the duration s = t₁ − t₀ and F fixed at the wall, ds = −(∂F/∂t₀ dt₀ + ∂F/∂w₀ dw₀)/w₁, with derivatives at fixed
    s, and dt₁ = dt₀ + ds. The impact law reflects the change of w₁. lost: 1 − e^(−δs).

    Returns
    -------
    tuple of float
        The four derivatives.
    """
    decay = 1.0 - lost
    sin0, cos0, inverse_delta = flight.sin0, flight.cos0, 1.0 / flight.delta
    f_w, f_t, v_t = flight_derivatives(lost, sin0, cos0, sin1, cos1, inverse_delta, flight.epsilon)
    bend = second_derivative(lost, sin1, cos1, flight)
    s_t, s_w = -f_t / w1, -f_w / w1
    return (
        1.0 + s_t,
        s_w,
        velocity_change_after_elastic_impact(bend * s_t + v_t),
        velocity_change_after_elastic_impact(bend * s_w + decay),
    )


@inline
def carry_tangent_over_flight(t, w, w1, bend, lost, sin0, cos0, sin1, cos1, inverse_delta, epsilon):
    """Return a tangent vector (dt, dw) carried over one flight and its impact, and the flight's determinant.

    t, w: dt and dw at the departure. w1, bend, lost: the velocity w₁ = F', F'' and 1 − e^(−δs) at the arrival.

    The determinant is e^(−δs) w₀/w₁ in absolute value:

        det = (w₁ ∂F'/∂w₀ − F'' ∂F/∂w₀ − ∂F/∂t₀ ∂F'/∂w₀ + ∂F/∂w₀ ∂F'/∂t₀)/w₁.

    The products with 1/w₁², which are large near grazing, cancel exactly.

    Returns
    -------
    tuple
        (dt, dw) after the reflection, and the absolute value e^(−δs) w₀/w₁ of the determinant.
    """
    decay = 1.0 - lost
    f_w, f_t, v_t = flight_derivatives(lost, sin0, cos0, sin1, cos1, inverse_delta, epsilon)
    inverse = 1.0 / w1
    dt = -(f_t * t + f_w * w) * inverse
    determinant = (w1 * decay - f_w * bend - f_t * decay + f_w * v_t) * inverse
    return (
        t + dt,
        velocity_change_after_elastic_impact(bend * dt + v_t * t + decay * w),
        determinant_of_impact(determinant),
    )

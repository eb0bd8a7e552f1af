"""Compiling, polynomials, complex-step derivatives, the secant method, sampling: nothing of the gear."""

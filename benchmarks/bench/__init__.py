"""Measure the speed of the library and of other integrators. No code of the product imports this package."""

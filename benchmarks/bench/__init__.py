"""Measured speed, peers included: no product code imports it."""

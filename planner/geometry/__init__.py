"""Parametric curves: derivatives from either side, breaks, arc length, and files that hold them."""

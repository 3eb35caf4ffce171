"""Interpolators of the literature, to compare with."""

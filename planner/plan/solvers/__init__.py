"""Solvers of the feedrate problem, one file each."""

"""Machines: the limits of their axes, and the files that hold them."""

"""Part programs: read, made into a path within tolerance, timed by the line."""

SUFFIXES = (".ngc", ".nc", ".tap")
"""Of the names of part programs."""
DEFAULT_TOLERANCE = 0.01  # mm, where neither the program nor the caller gives one

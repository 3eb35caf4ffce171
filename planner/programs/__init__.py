"""Part programs: read, made into a path within tolerance, timed by the line."""

SUFFIXES = (".ngc", ".nc", ".tap", ".gcode", ".cnc", ".eia", ".txt")
"""Of the names of part programs."""

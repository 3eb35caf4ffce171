"""Part programs: read, made into a path within tolerance, timed by the line."""

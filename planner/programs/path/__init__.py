"""The moves of a part program, made into a smooth path within tolerance."""

"""The text of a part program, made into moves."""

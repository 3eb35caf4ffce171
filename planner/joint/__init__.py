"""Path and feed as one problem: the fastest motion that stays within the tolerance of a chain of blocks."""

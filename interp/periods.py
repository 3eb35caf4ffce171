"""What counts as a whole number of periods, and how many samples may be asked for at once."""

# A time this close to a multiple of the period, in periods, is that multiple: its rounding must not add a sample.
WHOLE_PERIOD = 1e-9
MAX_SAMPLES = 100_000_000  # a few GB

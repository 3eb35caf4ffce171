"""Lower bounds on the time of every plan: their terms, their value, and the method that finds good multipliers."""

"""The real-time stage: samples of a plan, one point a period, and the interpolators of the literature."""

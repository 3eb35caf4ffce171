"""Drawings (DXF) as curves: their entities, the Bezier pieces of these, chains, and the B-spline of one chain."""

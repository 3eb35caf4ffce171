"""Jerk-limited S-curves between the feed minima of the limit curve: what industrial controls do today.

With s the arc length of the tool tip and t = q_s, k = q_ss, z = q_sss the machine axes' derivatives along it, a feed v
with tangential acceleration a and jerk J puts on axis j

    velocity |t v| <= V_j,   acceleration |t a + k v^2| <= A_j,   jerk |t J + 3 k v a + z v^3| <= J_j.

    feed |      limit curve .--------.
         |  __            .'  ______  '.          _______      nodes: no acceleration there
         |'   '.  __    .'  .'      '. '.  __.--''             blocks between them: ramp up, cruise, ramp down,
         |      ''  ''--o--'          '--o'                    each with its own top feed, two accelerations and jerk
         +--------------------------------------------- s

1. Limit curve: the feed that holds every limit at a = J = 0, on a grid refined until neighbours differ by 2 %.
2. Nodes: its minima (shallow ones merged), the curvature jumps that count, and both ends of the section.
3. A first plan: node feeds at 90 % of the limit curve; every block the S-curve (by ruckig) whose top feed, acceleration
   and jerk are the axes' full ones dilated in time, f, f^2 and f^3, by the largest f in a ladder that holds all limits at
   points along its ramps.  Where none does, the faster end of the block is lowered.
4. Improvement: compass search (Kolda, Lewis, Torczon, SIAM Review 45 (2003) 385-482) over the four numbers of a block and
   over the place and feed of a node.  A trial counts only if it holds the limits and saves time, so the plan is feasible
   whenever the search stops.  A block that cruises far below the limit curve gets a node in the middle of its cruise,
   which changes nothing yet, and the search goes on.
5. The time law u(t) is checked on the exact curve, densely; where it exceeds a limit, the margin there is raised and the
   blocks concerned are made feasible again.

Feasible because only step 5 lets a plan out.  A straight line needs no search: its first block is the time-optimal one.

At a jump of curvature the acceleration of axis j steps by |dk_j| v^2.  Sampled every period T, a step D shows up as a third
difference of D/T, so it is kept to 2/3 J_j T, and the jerk within three periods of it to J_j/2.

Limitations.  The tangential acceleration returns to zero at every node, and jerk is constant in a phase whatever the
axes would allow: 1 to 10 % slower than the optimum where acceleration rules, up to 40 % where jerk rules (the five-axis
flank path).  No bound on the time comes with it.  Where the tip rests while rotary axes move, arc length is no parameter.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from planner.errors import InfeasibleError, InputError, SolverError
from planner.geometry.curve import Break, Curve, FloatArray, Side
from planner.limits import Limits, chord_feed_limit
from planner.profile import evaluate_law

Nodes = tuple[FloatArray, FloatArray, FloatArray, FloatArray]

"""Models of the motion of controllers that people run, to tell how long a part program takes on theirs.

Each model follows the published rules of its controller and what that was measured to do; no formula of the planner.  The
table of them is :data:`planner.controllers.known.CONTROLLERS`.
"""

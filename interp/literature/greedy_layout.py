"""Numbers that the compiled loops of Algorithms 1 to 4 share with Python, as in ``interp/literature/greedy_inline.h``."""

# What a loop returns.
RUNNING = 0  # u_out is full
DONE = 1  # u has reached 1
SINGULAR = 2  # |C'| vanishes
NOT_FINITE = 3  # the step is not a positive number
NO_ADVANCE = 4  # u + du = u, or five steps below 1e-12
BACK_OFF = 5  # the factor theta reached 0, or too many passes
TOO_LONG = 6  # a step beyond a tenth of the range

# Indices into the settings.
PERIOD = 0  # T, s
FEED = 1  # F, mm/s
TOLERANCE = 2  # chord error, mm
SAFETY = 3  # lambda
RISE = 4  # end of the rising S-curve
FALL = 5  # start of the falling one
FLOOR = 6  # mm/s
JERK = 7  # mm/s^3, of the planned feedrate
ALGORITHM = 8
ROOT = 9  # 1: the step is solved for; 0: multiplied by theta as published
EXACT_TAYLOR = 10
PLANNED_FEED = 11  # 1: the planned feedrate drives the step; 0: the command
WRONG_BEND = 12  # scale of the butterfly whose published C'' is added; 0: the exact C''
SOFT = 13  # brake within acceleration and jerk, at the price of the feedrate limit
SINGULAR_SPEED = 14  # |C'| at which the curve has no direction
SETTINGS = 15

# Indices into the state.
U = 0
PLANNED = 1  # feedrate, mm/s
RATE = 2  # its change over the last period, mm/s^2
PIECE = 3
ERROR_PIECE = 4
TINY_STEPS = 5
COUNT = 6  # points written by the last call
DU = 7  # the last step
THETA = 8  # the last factor
SPEED = 9  # |C'| at u
STATE = 10

# Columns of what ``along`` writes.
LENGTH = 0  # of the chord to the next point, mm
ERROR = 1  # its distance from the curve, mm
AXIS_LIMIT = 2  # limit 2, mm/s
NORMAL_LIMIT = 3  # limit 4, mm/s
CURVATURE = 4  # 1/mm
SHAPE = 5  # S-curve factor
LOWEST = 6  # tangential acceleration allowed at the feed of the step before, mm/s^2
HIGHEST = 7
PUBLISHED_BOUND = 8  # the bound that the published program clips to, mm/s^2
COLUMNS = 9

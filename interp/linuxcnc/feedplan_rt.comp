component feedplan_rt "runs a plan of feedplan, one sample of the machine axes a period, with override and hold within limits";

description """
Reads a plan file (\\fBfeedplan export\\fR) when it is loaded, and gives the next sample in each period:

    loadrt feedplan_rt plan=/home/me/part.fpr
    addf feedplan-rt servo-thread

There are as many pins of positions as the plan has axes, in its order.  Run the thread at the period that the plan was made
for.  Before \\fBrun\\fR is true the position is the start of the plan: bring the machine there first.  A plan that was made
without a reserve obeys neither \\fBoverride\\fR nor \\fBhold\\fR, and does not stop before its end; \\fBgoverned\\fR tells.

To build and install it, in the folder that holds the folder interp:

    sudo halcompile --install interp/linuxcnc/feedplan_rt.comp
""";

option singleton yes;
option extra_setup yes;
option extra_cleanup yes;

pin out float position-#[9:personality] "Position of an axis, in the order of the plan, mm, or rad of a rotary axis";
pin in float override = 1.0 "Share of the planned rate that is asked for, 0 to 1; what is outside counts as the nearer end";
pin in bit hold "Asks for a stop on the path, as an override of 0 does";
pin in bit run "Starts the plan or goes on with it; false asks for a stop. After the end false, then true, begins it again, at its start: a jump where that is not its end";
pin out bit done "The end of the plan is reached";
pin out bit governed "The plan obeys override, hold and run";
pin out float feed "Feed of the linear axes during the last period, mm/s";
pin out float rate "Share of the planned rate at which the plan runs now";
pin out float plan_time "Time within the plan, s";
pin out float progress "Share of the plan's duration that is done, 0 to 1";
pin out s32 line "Number of the program line that is being run, 0 if the plan is of no program";

function _ fp "Goes to the next sample";

license "MIT";
author "feedplan";

include "interp/linuxcnc/feedplan_rt_inline.h";

;;

static char *plan = "";
RTAPI_MP_STRING(plan, "plan file");

static Runner runner;

EXTRA_SETUP()
{
    (void)prefix;
    (void)extra_arg;
    const char *problem = load_plan(&runner, plan);
    if (problem) {
        rtapi_print_msg(RTAPI_MSG_ERR, "feedplan_rt: plan=%s: %s\n", plan, problem);
        return -EINVAL;
    }
    personality = (int)runner.plan.dim; /* so many pins of positions are made */
    return 0;
}

EXTRA_CLEANUP()
{
    unload_plan(&runner);
}

FUNCTION(_)
{
    Shown shown;
    run_period(&runner, (double)period / 1e9, override, hold, run, &shown);
    for (int j = 0; j < personality; j++)
        position(j) = runner.at[j];
    done = shown.at_end;
    governed = shown.obeys;
    feed = shown.path_feed;
    rate = shown.plan_rate;
    plan_time = shown.time_done;
    progress = shown.share_done;
    line = (hal_s32_t)shown.program_line;
}

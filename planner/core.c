/* Which source the library was made from. */
#include "planner/core.h"

#ifndef FEEDPLAN_SOURCE
#error "FEEDPLAN_SOURCE must be the hash of the source; hatch_build.py gives it"
#endif

const char *core_source(void);

const char *core_source(void) { return FEEDPLAN_SOURCE; }

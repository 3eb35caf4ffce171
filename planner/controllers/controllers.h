/* Motion of other controllers, compiled. */
#ifndef PLANNER_CONTROLLERS_CONTROLLERS_H
#define PLANNER_CONTROLLERS_CONTROLLERS_H

#include <stdint.h>

/* How many doubles a machine, a move and a segment of LinuxCNC's queue are: out (3). */
void linuxcnc_sizes(int64_t *out);

/* Merge lines that LinuxCNC takes as one: kept (n) becomes 1 where such a line ends.  end (n, 3) are the ends of moves that
 * go on from start (3); tolerance (n) is that of merging, and before a move that is apart (n) no line goes on. */
void linuxcnc_merge(int64_t n, const double *end, const double *start, const double *tolerance, const uint8_t *apart,
                    uint8_t *kept);

/* Fill LinuxCNC's motion queue with n moves (n, move size), and return how many segments (2 n, segment size) that are:
 * the moves, shortened, and arcs that round their corners.  The queue runs empty before the first and after the last. */
int64_t linuxcnc_queue(const double *machine, int64_t n, const double *moves, double *segments);

/* Run the queue of count segments, period by period.  state (4) is 0 at first: the segment that is run, the time in
 * periods, whether all is done.  Writes at most most pieces (most, 9): time, segment (2 i on the lead of segment i, 2 i + 1
 * on the rest of it, -1 - i on both i and i + 1), distance along it, speed, acceleration, seconds, and the way X Y Z of one on
 * both.  Returns how many; call it again until state[2] is 1. */
int64_t linuxcnc_run(const double *machine, int64_t count, double *segments, double *state, int64_t most,
                     double *pieces);

#endif

#include "planner/core.h"
#include "planner/verify/motion_inline.h"
#include "planner/verify/verify.h"

static const double ANY_DIRECTION = 2.0;  /* turning of a span that counts: beyond 1 it is all the same */
static const double ANGLE = 1.5707963268; /* pi/2: an angle over the distance of its two directions, at most */
static const double BETWEEN = 1.25;       /* turning between points over that at them */

/* A span, and where it meets the one before it: largest acceleration across and along the path, turning of the direction, steps of
 * velocity and place; the last three summed up from the first span on. */
typedef struct {
    double *across, *along, *turn, *step, *jump;
} Spans;

/* Highest of the values in a window that moves on: those that may yet be the highest, first .. next of a queue. */
typedef struct {
    const double *value;
    int64_t *queue, first, next;
} Window;

static inline void window_take(Window *window, int64_t i)
{
    while (window->next > window->first && window->value[window->queue[window->next - 1]] <= window->value[i])
        window->next--;
    window->queue[window->next++] = i;
}

static inline double window_highest(Window *window, int64_t least)
{
    while (window->queue[window->first] < least)
        window->first++;
    return window->value[window->queue[window->first]];
}

static double apart(int64_t tip, const double *a, const double *b)
{
    double sum = 0.0;
    for (int64_t j = 0; j < tip; j++)
        sum += square(a[j] - b[j]);
    return sqrt(sum);
}

/* Sizes between the points: in half the time from one to the next the acceleration across and along the path gain what the jerk gives
 * them and what the turning of the direction takes from one to the other.  Where the direction is not known all of the acceleration
 * may be across.  A plan that goes back is not where the scan sees it, so there is no bound. */
static void measure_span(const double *course, double duration, int64_t points, int turning, Spans *of, int64_t i)
{
    const double across = course[0], along = course[1], swing = course[2];
    const double half = 0.5 * duration / (double)(points - 1);
    double turn = ANY_DIRECTION;
    if (turning && swing < INFINITY) {
        of->across[i] = across + half * (course[4] + along * swing);
        of->along[i] = along + half * (course[3] + across * swing);
        turn = BETWEEN * swing * duration;
    } else {
        of->across[i] = sqrt(square(across) + square(along)) + half * sqrt(square(course[3]) + square(course[4]));
        of->along[i] = 0.0;
    }
    of->turn[i + 1] = of->turn[i] + smaller(turn, ANY_DIRECTION);
}

static Spans measure_spans(int64_t spans, int64_t tip, int64_t points, int turning, const double *time, const double *course,
                           double *work)
{
    Spans of = {work, work + spans, work + 2 * spans, work + 3 * spans + 1, work + 4 * spans + 2};
    of.turn[0] = of.step[0] = of.jump[0] = 0.0;
    for (int64_t i = 0; i < spans; i++, course += COURSE_SIZES + 6 * tip) {
        measure_span(course, time[spans + i] - time[i], points, turning, &of, i);
        of.step[i + 1] = of.step[i];
        of.jump[i + 1] = of.jump[i];
        if (i > 0) {
            const double *begin = course + COURSE_SIZES, *end = begin - COURSE_SIZES - 3 * tip;
            of.jump[i + 1] += apart(tip, begin, end);
            of.step[i + 1] += apart(tip, begin + tip, end + tip);
            of.turn[i + 1] += smaller(ANGLE * apart(tip, begin + 2 * tip, end + 2 * tip), ANY_DIRECTION);
        }
    }
    return of;
}

/* A function is off its linear interpolation over T by T^2 / 8 times its second derivative, by T / 4 times a step of the first, and
 * by a step of its own.  Only what is across the chord counts, which lies among the directions of the path while these turn by less
 * than a right angle: all of the acceleration across the path, and of that along it the sine. */
void chord_bounds(int64_t spans, int64_t tip, int64_t points, int64_t turning, const double *time, const double *course,
                  double period, int64_t n, const double *from, const double *to, double *bound, double *work, int64_t *queue)
{
    const Spans of = measure_spans(spans, tip, points, turning != 0, time, course, work);
    Window across = {of.across, queue, 0, 0}, along = {of.along, queue + spans, 0, 0};
    int64_t first = 0, next = 0;
    for (int64_t i = 0; i < n; i++) {
        for (; next < spans && (next == 0 || time[next] <= to[i]); next++) {
            window_take(&across, next);
            window_take(&along, next);
        }
        while (first < next - 1 && time[spans + first] < from[i])
            first++;
        const double turn = smaller(of.turn[next] - of.turn[first], 1.0);
        const double most = window_highest(&across, first) + turn * window_highest(&along, first);
        const double sum = square(period) / 8.0 * most + period / 4.0 * (of.step[next] - of.step[first]) +
                           2.0 * (of.jump[next] - of.jump[first]);
        bound[i] = sum < INFINITY ? sum : INFINITY;
    }
}

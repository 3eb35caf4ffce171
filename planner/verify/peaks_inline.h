/* The highest of a row of numbers. */
#ifndef PLANNER_VERIFY_PEAKS_INLINE_H
#define PLANNER_VERIFY_PEAKS_INLINE_H

#include "planner/core.h"

/* Vectors that GCC and Clang have in C, made of narrower ones where the processor has none so wide.  No functions take
 * them: they are passed in other ways by processors that have them. */
enum { FOUR = 4 };
typedef double Four __attribute__((vector_size(8 * FOUR)));
typedef int64_t FourBits __attribute__((vector_size(8 * FOUR)));
/* Anywhere in an array of numbers. */
typedef double FourAnywhere __attribute__((vector_size(8 * FOUR), aligned(8), may_alias));
#define FOUR_AT(address) ((Four) * (const FourAnywhere *)(address))
#define FOUR_OF(mask, a, b) ((Four)(((FourBits)(a) & (mask)) | ((FourBits)(b) & ~(mask))))
#define FOUR_LARGER(a, b) FOUR_OF((b) > (a), b, a)

/* The highest of n numbers and of one more. */
static inline __attribute__((always_inline)) double highest_number(int64_t n, const double *heights, double most)
{
    int64_t k = 0;
    if (n >= 2 * FOUR) { /* two rows of lanes, for one would wait for every comparison */
        Four top = FOUR_AT(heights), other = FOUR_AT(heights + FOUR);
        for (k = 2 * FOUR; k + 2 * FOUR <= n; k += 2 * FOUR) {
            const Four next = FOUR_AT(heights + k), after = FOUR_AT(heights + k + FOUR);
            top = FOUR_LARGER(top, next);
            other = FOUR_LARGER(other, after);
        }
        top = FOUR_LARGER(top, other);
        most = larger(most, larger(larger(top[0], top[1]), larger(top[2], top[3])));
    }
    for (; k < n; k++)
        most = larger(most, heights[k]);
    return most;
}

/* Index of the highest, of equal ones the first. */
static inline __attribute__((always_inline)) int64_t highest(int64_t n, const double *heights)
{
    const double most = highest_number(n, heights, heights[0]);
    /* From the end on, so that the first stays; no branch depends on where it is, for a processor guesses that wrong. */
    int64_t at = n, whole = n / FOUR * FOUR;
    for (int64_t k = n - 1; k >= whole; k--)
        at = heights[k] == most ? k : at;
    FourBits first = {n, n, n, n}, here = {whole, whole + 1, whole + 2, whole + 3};
    for (int64_t k = whole - FOUR; k >= 0; k -= FOUR) {
        const Four next = FOUR_AT(heights + k);
        here -= FOUR;
        const FourBits is = next == most;
        first = (here & is) | (first & ~is);
    }
    for (int l = 0; l < FOUR; l++)
        at = first[l] < at ? first[l] : at;
    return at < n ? at : 0; /* most is no number only where the first is none */
}

/* Height of the highest point, or where it lies inside, of the parabola through it and its neighbours. */
static inline double peak(int64_t n, const double *heights, int64_t top)
{
    if (top > 0 && top < n - 1) {
        const double before = heights[top - 1], after = heights[top + 1];
        const double bend = before - 2.0 * heights[top] + after;
        if (-INFINITY < bend && bend < 0.0)
            return heights[top] - square(before - after) / (8.0 * bend);
    }
    return heights[top];
}

/* The highest of a row: how high, known by their index, and where. */
typedef struct {
    int64_t room, *kept;
    double *height;
    int64_t *index;
    double *x;
} Tops;

static inline int precedes(double height, int64_t index, double other, int64_t other_index)
{
    return height > other || (height == other && index < other_index);
}

/* Take one among the highest where it is; of equal ones that of the least index. */
static inline void tops_take(const Tops *tops, double height, int64_t index, double x)
{
    int64_t at = *tops->kept;
    if (at == tops->room && !precedes(height, index, tops->height[at - 1], tops->index[at - 1]))
        return;
    /* An insertion: those that are lower move on, and the last of a full row falls out. */
    at = at == tops->room ? at - 1 : (*tops->kept)++;
    for (; at > 0 && precedes(height, index, tops->height[at - 1], tops->index[at - 1]); at--) {
        tops->height[at] = tops->height[at - 1];
        tops->index[at] = tops->index[at - 1];
        tops->x[at] = tops->x[at - 1];
    }
    tops->height[at] = height;
    tops->index[at] = index;
    tops->x[at] = x;
}

#endif

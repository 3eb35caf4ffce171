/* Opens mutated plan files and steps through those that are accepted.  Input: size of the file (int64), the file, the number of
   mutants (int64), and for each mutant how many bytes differ (int64), and for each of these place and value (int64, int64); and
   whether to mend the checksum (int64).  Output: how many were refused, and how many accepted ones had other samples. */
#include "interp/step.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int64_t number(void)
{
    int64_t found;
    if (fread(&found, sizeof found, 1, stdin) != 1)
        exit(2);
    return found;
}

static uint32_t crc32_of(const unsigned char *bytes, size_t size)
{
    uint32_t found = 0xffffffffu;
    for (size_t i = 0; i < size; i++) {
        found ^= bytes[i];
        for (int bit = 0; bit < 8; bit++)
            found = (found >> 1) ^ (0xedb88320u & (0u - (found & 1u)));
    }
    return ~found;
}

/* Sum of the samples' bits over a run with override and hold; a few thousand steps at most. */
static uint64_t run(const void *bytes, size_t size, int *wrong)
{
    feedplan_plan plan;
    feedplan_state state;
    double position[FEEDPLAN_MAX_AXES];
    uint64_t sum = 0;
    *wrong = feedplan_open(&plan, bytes, size);
    if (*wrong || (*wrong = feedplan_start(&plan, &state, plan.period)))
        return 0;
    for (int part = 0; part < 4; part++) {
        if (feedplan_seek(&plan, &state, 0.25 * part * plan.duration, 1.0))
            break;
        for (int k = 0; k < 200; k++) {
            feedplan_step(&plan, &state, k % 100 < 50 ? 1.0 : 0.3, k % 37 == 0, position);
            for (int64_t j = 0; j < plan.dim; j++) {
                uint64_t bits;
                memcpy(&bits, position + j, sizeof bits);
                sum = sum * 31 + bits;
            }
            sum += (uint64_t)feedplan_line(&plan, &state) + (uint64_t)feedplan_axis_name(&plan, k % 3)[0];
        }
    }
    return sum;
}

int main(void)
{
    const size_t size = (size_t)number();
    unsigned char *file = malloc(size);
    if (!file || fread(file, 1, size, stdin) != size)
        return 2;
    int wrong;
    const uint64_t expected = run(file, size, &wrong);
    if (wrong)
        return 3;
    int64_t refused = 0, other = 0;
    for (int64_t left = number(); left > 0; left--) {
        int64_t cut = number(), changes = number();
        /* A buffer of its own size: a read beyond it is seen. */
        const size_t length = cut < 0 ? size : (size_t)cut;
        unsigned char *mutant = malloc(length ? length : 1);
        if (!mutant)
            return 2;
        memcpy(mutant, file, length);
        for (; changes > 0; changes--) {
            const int64_t at = number(), value = number();
            if ((size_t)at < length)
                mutant[at] = (unsigned char)value;
        }
        if (number() && length > 32) {
            const uint32_t sum = crc32_of(mutant + 32, length - 32);
            memcpy(mutant + 24, &sum, sizeof sum);
        }
        const uint64_t found = run(mutant, length, &wrong);
        refused += wrong != 0;
        other += !wrong && found != expected;
        free(mutant);
    }
    free(file);
    printf("%lld %lld\n", (long long)refused, (long long)other);
    return 0;
}

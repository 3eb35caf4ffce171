/* What every file of the compiled core begins with. */
#ifndef FEEDPLAN_CORE_H
#define FEEDPLAN_CORE_H

#include <math.h>
#include <stdint.h>

/* A function before which HOT stands is compiled twice, for any processor and for one with AVX2; which of them runs is
   chosen when the library is loaded.  Products and sums are never contracted, so both give the same bits. */
#if defined(__x86_64__) && defined(__gnu_linux__) && !defined(FEEDPLAN_ONE_TARGET)
#define HOT __attribute__((target_clones("avx2", "default")))
#else
#define HOT
#endif

/* As Python's max and min: the first of equals, and the first also where the second is not a number. */
static inline double larger(double a, double b) { return b > a ? b : a; }
static inline double smaller(double a, double b) { return b < a ? b : a; }

static inline double square(double a) { return a * a; }

#endif

/* Reading a part program, compiled. */
#ifndef PLANNER_PROGRAMS_READING_READING_H
#define PLANNER_PROGRAMS_READING_READING_H

#include <stdint.h>

/* Split text (size) into words, a letter and a number each; returns how many.
 *
 * first and stop are the offsets of a word in the text, line counts from 0; letter is a capital, or % without a
 * number.  These arrays must have room for size / 2 + 2 words and one more for each %.  At the first character that
 * fits nowhere the scan ends with fault (3) = what is wrong, offset, line: 1 a byte of no text, 2 a character that
 * starts no word, 3 a number without a letter, 4 a letter without a number, 5 a comment that does not close, or holds
 * another; 0 where all is well. */
int64_t words_scan(int64_t size, const uint8_t *text, uint8_t *letter, double *value, int32_t *first, int32_t *stop,
                   int32_t *line, int64_t *fault);

/* Mark in keep (n) the moves that lead farther than the threshold from where the last kept one ended, and those always
 * (n) kept.
 *
 * Measured from there, and not from the programmed point before, many short moves cannot add up to a lost one.  ends
 * (n, axes); position (axes) is where the first starts, and then where the last kept one ends. */
void reader_merge_short_moves(int64_t n, int64_t axes, const double *ends, const uint8_t *always, double threshold,
                              double *position, uint8_t *keep);

#endif

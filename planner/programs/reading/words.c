#include "planner/programs/reading/reading.h"

#include "planner/core.h"

/* What can be wrong with a character. */
enum { NOTHING, BYTE, CHARACTER, NO_LETTER, NO_NUMBER, OPEN_COMMENT };

/* Digits beyond the 17th do not change a double; 10^22 is the largest power of ten that is one exactly. */
#define MAX_MANTISSA 100000000000000000
#define EXACT_POWERS 23
static const double POWERS[EXACT_POWERS] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                            1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

typedef struct {
    double value;
    int64_t end, digits;
} Number;

static inline int is_digit(uint8_t c) { return '0' <= c && c <= '9'; }
static inline int is_blank(uint8_t c) { return c == ' ' || c == '\t'; }
static inline int is_space(uint8_t c) { return c == ' ' || c == '\t' || c == '\r' || c == '\n'; }

/* 10^n by squaring. */
static double power_of_ten(int64_t n)
{
    if (n < EXACT_POWERS)
        return POWERS[n];
    double result = 1.0;
    for (double base = 10.0; n != 0; n >>= 1, base *= base)
        if (n & 1)
            result *= base;
    return result;
}

/* Index of the character that closes a comment opened at i, or -1 - index of the one that must not be there. */
static int64_t comment_end(int64_t size, const uint8_t *text, int64_t i, uint8_t close)
{
    for (int64_t j = i + 1; j < size; j++) {
        const uint8_t c = text[j];
        if (c == close)
            return j;
        const int control = (c < ' ' && c != '\t' && c != '\r') || c == 127;
        if (control || (c == '(' && close == ')'))
            return -1 - j;
    }
    return close == '\n' ? size : -1 - size;
}

/* The decimal number at an offset, with any number of signs: its value, where it ends, and how many digits it has. */
static Number number_at(int64_t size, const uint8_t *text, int64_t j)
{
    double sign = 1.0;
    int64_t mantissa = 0, decimals = 0, dropped = 0, digits = 0, dot = 0;
    for (; j < size && (text[j] == '-' || text[j] == '+' || is_blank(text[j])); j++)
        if (text[j] == '-')
            sign = -sign;
    for (; j < size && (is_digit(text[j]) || (text[j] == '.' && !dot)); j++) {
        if (text[j] == '.') {
            dot = 1;
            continue;
        }
        digits++;
        if (mantissa < MAX_MANTISSA) {
            mantissa = 10 * mantissa + (text[j] - '0');
            decimals += dot;
        } else {
            dropped += !dot;
        }
    }
    double value = sign * ((double)mantissa / power_of_ten(decimals));
    if (dropped > 0)
        value *= power_of_ten(dropped);
    const Number number = {value, j, digits};
    return number;
}

/* What is wrong with a character that starts no word. */
static int64_t stray(uint8_t c)
{
    if (is_digit(c) || c == '+' || c == '-' || c == '.')
        return NO_LETTER;
    return ' ' < c && c < 127 ? CHARACTER : BYTE;
}

static int64_t ended_with(int64_t *fault, int64_t what, int64_t offset, int64_t line, int64_t words)
{
    fault[0] = what;
    fault[1] = offset;
    fault[2] = line;
    return words;
}

int64_t words_scan(int64_t size, const uint8_t *text, uint8_t *letter, double *value, int32_t *first, int32_t *stop,
                   int32_t *line, int64_t *fault)
{
    int64_t n = 0, at_line = 0, i = 0;
    while (i < size) {
        uint8_t c = text[i];
        if (is_space(c)) {
            at_line += c == '\n';
            i++;
            continue;
        }
        if (c == '(' || c == ';') {
            const int64_t end = comment_end(size, text, i, c == '(' ? ')' : '\n');
            if (end < 0) {
                const int64_t bad = -1 - end;
                const int open_ended = bad >= size || text[bad] == '\n' || text[bad] == '(';
                return open_ended ? ended_with(fault, OPEN_COMMENT, i, at_line, n)
                                  : ended_with(fault, BYTE, bad, at_line, n);
            }
            i = c == '(' ? end + 1 : end;
            continue;
        }
        if ('a' <= c && c <= 'z')
            c -= 'a' - 'A';
        Number number = {0.0, i + 1, 0};
        int64_t what = NOTHING;
        if ('A' <= c && c <= 'Z') {
            number = number_at(size, text, i + 1);
            what = number.digits > 0 ? NOTHING : NO_NUMBER;
        } else if (c != '%') {
            what = stray(c);
        }
        if (what != NOTHING)
            return ended_with(fault, what, i, at_line, n);
        letter[n] = c;
        value[n] = number.value;
        first[n] = (int32_t)i;
        stop[n] = (int32_t)number.end;
        line[n] = (int32_t)at_line;
        n++;
        i = number.end;
    }
    return n;
}

"""Numbers, parameters and expressions of a block, as LinuxCNC evaluates them.

From the strongest: ``**``; ``*`` ``/`` ``MOD``; ``+`` ``-``; ``EQ NE GT GE LT LE``; ``AND OR XOR``; each from left to
right.  A sign belongs to its number: -2**2 = 4, 2**3**2 = 64.  Angles are in degrees, FIX and FUP go down and up, MOD is
never negative, and numbers that differ by less than 1e-6 are EQ.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

_EQUAL = 1e-6
_MAX_DEPTH = 50  # of brackets and of ##
MAX_ARGUMENTS = 30  # of a call, #1 to #30, which it has of its own

ParameterKey = int | str
_NUMBER = re.compile(r"\d+\.?\d*|\.\d+")
_NAME = re.compile(r"#<([^<>]+)>")
_FUNCTION = re.compile(r"(ABS|ACOS|ASIN|ATAN|COS|EXISTS|EXP|FIX|FUP|LN|ROUND|SIN|SQRT|TAN)\[")


class LineError(Exception):
    """Something in a line cannot be evaluated: the word, and why."""

    def __init__(self, word: str, reason: str) -> None:
        super().__init__(f"{word}: {reason}")
        self.word, self.reason = word, reason


@dataclass
class Parameters:
    """The parameters of a program: those of all, and of each call its own #1 to #30 and named ones without _."""

    common: dict[ParameterKey, float] = field(default_factory=dict)
    own: list[dict[ParameterKey, float]] = field(default_factory=lambda: [{}])
    machine: Callable[[ParameterKey], float | None] = lambda _key: None  # where the program sets none

    def _table(self, key: ParameterKey) -> dict[ParameterKey, float]:
        local = 1 <= key <= MAX_ARGUMENTS if isinstance(key, int) else not key.startswith("_")
        return self.own[-1] if local else self.common

    def get(self, key: ParameterKey) -> float | None:
        """The value of a parameter, None where it is not set."""
        value = self._table(key).get(key)
        return self.machine(key) if value is None else value

    def set(self, key: ParameterKey, value: float) -> None:
        """Set a parameter."""
        self._table(key)[key] = value

    def forget(self, keys: Iterable[ParameterKey]) -> None:
        """Let parameters of all be those of the machine again."""
        for key in keys:
            self.common.pop(key, None)


@dataclass(frozen=True)
class EvaluatedLine:
    """Words of a line, each letter, number, and from where to where it stands; and what it sets, which acts after it."""

    words: list[tuple[str, float, int, int]]
    sets: list[tuple[ParameterKey, float]]


def _fix(x: float) -> float:
    return float(math.floor(x))


def _fup(x: float) -> float:
    return float(math.ceil(x))


def _round(x: float) -> float:
    return math.copysign(math.floor(abs(x) + 0.5), x)


_FUNCTIONS: dict[str, Callable[[float], float]] = {
    "ABS": abs,
    "ACOS": lambda x: math.degrees(math.acos(x)),
    "ASIN": lambda x: math.degrees(math.asin(x)),
    "COS": lambda x: math.cos(math.radians(x)),
    "EXP": math.exp,
    "FIX": _fix,
    "FUP": _fup,
    "LN": math.log,
    "ROUND": _round,
    "SIN": lambda x: math.sin(math.radians(x)),
    "SQRT": math.sqrt,
    "TAN": lambda x: math.tan(math.radians(x)),
}


def _modulo(a: float, b: float) -> float:
    return math.fmod(a, b) + (abs(b) if math.fmod(a, b) < 0.0 else 0.0)


_OPERATORS: list[dict[str, Callable[[float, float], float]]] = [
    {
        "AND": lambda a, b: float(a != 0.0 and b != 0.0),
        "XOR": lambda a, b: float((a != 0.0) != (b != 0.0)),
        "OR": lambda a, b: float(a != 0.0 or b != 0.0),
    },
    {
        "EQ": lambda a, b: float(abs(a - b) < _EQUAL),
        "NE": lambda a, b: float(abs(a - b) >= _EQUAL),
        "GE": lambda a, b: float(a >= b),
        "GT": lambda a, b: float(a > b),
        "LE": lambda a, b: float(a <= b),
        "LT": lambda a, b: float(a < b),
    },
    {"+": lambda a, b: a + b, "-": lambda a, b: a - b},
    {"*": lambda a, b: a * b, "/": lambda a, b: a / b, "MOD": _modulo},
    {"**": lambda a, b: float(a**b)},
]


class LineEvaluator:
    """Evaluates one line, in capitals and without spaces and comments."""

    def __init__(self, text: str, parameters: Parameters) -> None:
        self.text, self.parameters = text, parameters
        self.at, self.depth = 0, 0

    def line(self) -> EvaluatedLine:
        """All words of the line, and what it sets."""
        words, sets = [], []
        while self.at < len(self.text):
            first, letter = self.at, self.text[self.at]
            if letter == "#":
                key = self._key()
                if not self._took("="):
                    raise LineError(self.text[first:], "a parameter that starts a word is set with =")
                sets.append((key, self.value()))
            elif "A" <= letter <= "Z" or letter in "@^":
                self.at += 1
                words.append((letter, self.value(), first, self.at))
            else:
                raise LineError(self.text[first : first + 20], "no word starts with it")
        return EvaluatedLine(words, sets)

    def brackets(self) -> list[float]:
        """The values of the expressions [..][..] that the rest of the line is made of."""
        out = []
        while self.at < len(self.text):
            if self.text[self.at] != "[":
                raise LineError(self.text[self.at :], "an expression in brackets [ ] belongs here")
            out.append(self.value())
        return out

    def value(self) -> float:
        """A number, a parameter, an expression in brackets or a function, with signs before it."""
        first, sign = self.at, 1.0
        while self.at < len(self.text) and self.text[self.at] in "+-":
            sign = -sign if self.text[self.at] == "-" else sign
            self.at += 1
        number = _NUMBER.match(self.text, self.at)
        if number:
            self.at = number.end()
            return sign * float(number[0])
        function = _FUNCTION.match(self.text, self.at)
        if function:
            return sign * self._function(function[1], first)
        if self.text.startswith("[", self.at):
            return sign * self._bracket()
        if self.text.startswith("#", self.at):
            return sign * self._parameter()
        raise LineError(self.text[max(first - 1, 0) :][:20], "a number, a parameter or an expression is missing")

    def _took(self, token: str) -> bool:
        if not self.text.startswith(token, self.at):
            return False
        self.at += len(token)
        return True

    def _enter(self) -> None:
        self.at += 1
        self.depth += 1
        if self.depth > _MAX_DEPTH:
            raise LineError(self.text[:20], f"more than {_MAX_DEPTH} brackets or # within each other")

    def _bracket(self) -> float:
        first = self.at
        self._enter()
        value = self._operation(0, first)
        self.depth -= 1
        if not self._took("]"):
            raise LineError(self.text[first:], "the bracket is not closed, or holds what is no expression")
        return value

    def _operation(self, level: int, first: int) -> float:
        if level == len(_OPERATORS):
            return self.value()
        left = self._operation(level + 1, first)
        while True:
            name = next((name for name in _OPERATORS[level] if self.text.startswith(name, self.at)), None)
            if name is None or (name == "*" and self.text.startswith("**", self.at)):
                return left
            self.at += len(name)
            right = self._operation(level + 1, first)
            left = self._checked(first, _OPERATORS[level][name], left, right)

    def _function(self, name: str, first: int) -> float:
        self.at += len(name)
        if name == "EXISTS":
            inner = _NAME.match(self.text, self.at + 1)
            if inner is None or not self.text.startswith("]", inner.end()):
                raise LineError(self.text[first:], "EXISTS asks for a named parameter, EXISTS[#<name>]")
            self.at = inner.end() + 1
            return float(self.parameters.get(inner[1].lower()) is not None)
        argument = self._bracket()
        if name == "ATAN":
            if not self.text.startswith("/[", self.at):
                raise LineError(self.text[first:], "ATAN needs two arguments, ATAN[y]/[x]")
            self.at += 1
            return math.degrees(math.atan2(argument, self._bracket()))
        return self._checked(first, _FUNCTIONS[name], argument)

    def _checked(self, first: int, operation: Callable[..., float], *arguments: float) -> float:
        """A result, or why there is none."""
        word = self.text[first : self.at]
        try:
            value = operation(*arguments)
        except ZeroDivisionError:
            raise LineError(word, "divides by 0") from None
        except (ValueError, TypeError):  # also of a root that is complex
            raise LineError(word, "is not defined for its argument") from None
        except OverflowError:
            raise LineError(word, "is too large") from None
        if not math.isfinite(value):
            raise LineError(word, "is too large")
        return value

    def _key(self) -> ParameterKey:
        """Number or name behind a #."""
        first = self.at
        name = _NAME.match(self.text, self.at)
        if name:
            self.at = name.end()
            return name[1].lower()
        self._enter()
        value = self.value()
        self.depth -= 1
        if value != round(value) or not 1 <= value <= 5602:
            raise LineError(self.text[first : self.at], "the number of a parameter is a whole number from 1 to 5602")
        return int(value)

    def _parameter(self) -> float:
        first = self.at
        key = self._key()
        value = self.parameters.get(key)
        if value is None:
            raise LineError(self.text[first : self.at], "the parameter is not set before it is read")
        return value

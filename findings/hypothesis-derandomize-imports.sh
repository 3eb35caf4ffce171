#!/usr/bin/env bash
# Hypothesis 6.170.17 with pytest 9.2.0, Python 3.11.
#
# A property test with derandomize=True and no database draws the same examples in every run of the same files.  One would
# swear that they depend on the test alone.  They do not: Hypothesis reads the constants (numbers and strings) of the local
# modules that happen to be imported, and draws some of them.  So the same test, unchanged, draws other examples once another
# test file that imports another module runs before it in the same process.
#
# What that means: a test that is green alone may be red in the whole suite, and the other way round; a falsifying example
# belongs into an @example of its own, where it is tried whatever else runs.
#
# Seen: alone, twice:                       DRAWN 480d245e927162d8 200
#       after a file that imports other.py: DRAWN 7c8c5f52681354f0 200
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/python" -m pip install -q hypothesis==6.170.17 pytest==9.2.0
mkdir "$work/project"
cd "$work/project"

cat > test_draws.py <<'PY'
import hashlib

from hypothesis import given, settings, strategies as st

drawn = []


@settings(derandomize=True, database=None, max_examples=200)
@given(st.floats(), st.text(max_size=8))
def test_draws(x, text):
    drawn.append((repr(x), text))


def test_print():
    print("DRAWN", hashlib.sha256(repr(drawn).encode()).hexdigest()[:16], len(drawn))
PY
cat > other.py <<'PY'
NUMBERS = [31415.926535, 2718281.828, 1.4142135623e-7, 577215.664]
NAMES = ["alabaster", "burgundy", "cerulean"]
PY
cat > test_before.py <<'PY'
import other


def test_other():
    assert other.NAMES
PY

draws() { PYTHONPATH=. "$work/venv/bin/python" -m pytest -q -s -p no:cacheprovider "$@" | grep -o 'DRAWN .*'; }
first=$(draws test_draws.py)
second=$(draws test_draws.py)
together=$(draws test_before.py test_draws.py)
echo "alone:         $first"
echo "alone again:   $second"
echo "after another: $together"
[ "$first" = "$second" ] || { echo "changed: two runs of the same file draw differently"; exit 1; }
[ "$first" != "$together" ] || { echo "changed: what is imported no longer matters"; exit 1; }

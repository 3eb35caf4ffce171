#!/usr/bin/env bash
# pandas 3.1.1 with numpy 2.4.6, Python 3.11.
#
# pandas.DataFrame of a structured numpy array has a column for each field, by name.  One would swear that an object which
# numpy turns into that array (it has __array__) gives the same frame.  It does not: where the object can be iterated, pandas
# takes the rows one by one and makes a single column of records, called 0; where it cannot, the constructor refuses it.
# Rows that are namedtuples give the named columns.
#
# Seen: the array itself            (2, 2) ['t', 'u']
#       __array__ and __iter__      (2, 1) [0]
#       __array__ alone             ValueError
#       __iter__ over namedtuples   (2, 2) ['t', 'u']
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/python" -m pip install -q pandas==3.1.1 numpy==2.4.6
cat > "$work/frames.py" <<'PY'
from collections import namedtuple

import numpy as np
import pandas as pd

TABLE = np.array([(1.0, 2.0), (3.0, 4.0)], dtype=[("t", float), ("u", float)])
Row = namedtuple("Row", "t u")


class Convertible:
    def __array__(self, dtype=None, copy=None):
        return TABLE


class Iterable(Convertible):
    def __iter__(self):
        return iter(TABLE)


class Rows:
    def __iter__(self):
        return map(Row._make, TABLE.tolist())


for what in (TABLE, Iterable(), Convertible(), Rows()):
    assert what is TABLE or isinstance(what, Rows) or np.asarray(what).dtype.names == ("t", "u")
    try:
        frame = pd.DataFrame(what)
    except ValueError:
        print("ValueError")
    else:
        print(frame.shape, list(frame.columns))
PY
cd "$work"
"$work/venv/bin/python" frames.py | tee seen
printf '%s\n' "(2, 2) ['t', 'u']" "(2, 1) [0]" "ValueError" "(2, 2) ['t', 'u']" | diff - seen || { echo "changed"; exit 1; }

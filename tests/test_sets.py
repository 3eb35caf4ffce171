"""Sets of numbers: as numpy's union."""

import subprocess
import sys

import numpy as np
import pytest

from planner.sets import union


@pytest.mark.parametrize("dtype", [np.float64, np.intp])
@pytest.mark.parametrize("sizes", [(0,), (1,), (7,), (0, 0), (5, 0, 300), (100, 100)])
def test_a_union_is_that_of_numpy(dtype, sizes):
    rng = np.random.default_rng(sum(sizes))
    values = [rng.integers(-20, 20, size).astype(dtype) for size in sizes]
    kept = [value.copy() for value in values]
    found = union(*values)
    assert found.dtype == dtype
    np.testing.assert_array_equal(found, np.unique(np.concatenate(values)))
    for value, before in zip(values, kept, strict=True):
        np.testing.assert_array_equal(value, before)


def test_arrays_of_any_shape_are_taken():
    np.testing.assert_array_equal(
        union(np.array([[3.0, 1.0], [1.0, 2.0]]), np.array([np.inf])), [1.0, 2.0, 3.0, np.inf]
    )


def test_it_loads_no_masked_arrays():
    code = "import sys, numpy; from planner.sets import union; union(numpy.ones(3)); print('numpy.ma' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "False\n"

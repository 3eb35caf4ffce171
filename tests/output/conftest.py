"""A small plan and its table, for the tests of tables."""

import pytest
from table_lines import LIMITS, small_plan

from planner import write_table


@pytest.fixture(scope="module")
def plan():
    return small_plan()


@pytest.fixture
def table(tmp_path, plan):
    """A table on disk, and its lines."""
    path = tmp_path / "table.csv"
    write_table(path, plan, LIMITS)
    return path, path.read_text().splitlines(keepends=True)

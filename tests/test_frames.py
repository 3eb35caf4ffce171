"""Results as tables: the same columns whichever way they are asked for."""

from __future__ import annotations

import builtins
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

from planner.frames import Tabular, html_table


class Steps(Tabular):
    """Three columns of n rows."""

    def __init__(self, count):
        self.count = count

    def columns(self):
        names = np.array([f"<{k}>" for k in range(self.count)], dtype=object)
        return {"t_s": 0.5 * np.arange(self.count), "name": names, "ok": np.arange(self.count) % 2 == 0}

    def __repr__(self):
        return f"Steps(<{self.count}>)"


class Cells(HTMLParser):
    """The texts of the cells of a page, row by row."""

    def __init__(self, text):
        super().__init__()
        self.rows, self.inside = [], False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self.inside = True

    def handle_endtag(self, tag):
        self.inside = self.inside and tag not in ("td", "th")

    def handle_data(self, data):
        if self.inside:
            self.rows[-1][-1] += data


@pytest.mark.parametrize("count", [1, 3, 40])
def test_pandas_reads_it_either_way(count):
    steps = Steps(count)
    expected = pd.DataFrame(steps.columns())
    pd.testing.assert_frame_equal(steps.to_frame(), expected)
    pd.testing.assert_frame_equal(pd.DataFrame(steps), expected)
    assert len(steps) == count


def test_rows_have_names():
    first, second = Steps(2)
    assert (first.t_s, first.name, first.ok) == (0.0, "<0>", True)
    assert second._asdict() == {"t_s": 0.5, "name": "<1>", "ok": False}


def test_without_pandas_the_columns_themselves(monkeypatch):
    real = builtins.__import__

    def without(name, *rest):
        if name == "pandas":
            raise ImportError(name)
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    found = Steps(4).to_frame()
    assert type(found) is dict
    assert list(found) == ["t_s", "name", "ok"]
    assert np.array_equal(found["t_s"], 0.5 * np.arange(4))


@pytest.mark.parametrize(("count", "rows"), [(1, 1), (11, 11), (12, 11), (1000, 11)])
def test_a_notebook_shows_both_ends(count, rows):
    steps = Steps(count)
    found = Cells(html_table(steps.columns())).rows
    assert found[0] == ["t_s", "name", "ok"]
    assert len(found) == rows + 1
    assert found[1] == ["0", "<0>", "True"]
    assert found[-1][1] == f"<{count - 1}>"
    assert (["..."] * 3 in found) == (count > 11)
    assert steps._repr_html_().startswith("<p>Steps(&lt;")

"""What several tests share: where files are, curves, limits and reference optima."""

from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1]
PROGRAMS = PROJECT / "tests" / "data" / "programs"  # part programs, see README.md there
CURVES = PROJECT / "tests" / "data" / "curves"  # curves that once went wrong, see SOURCE.md there

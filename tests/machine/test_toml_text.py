"""Machine files that are written are read as the same machine."""

import pytest
from cases import PROJECT

from planner.machine.limits import Limits
from planner.machine.machine_file import EXAMPLE_MACHINES, read_machine
from planner.machine.machine_toml import toml_machine
from planner.machine.program_setup import ProgramSetup
from planner.machine.toml_text import toml_text


@pytest.mark.parametrize("name", EXAMPLE_MACHINES)
def test_example_machines(name, tmp_path):
    machine = read_machine(name)
    again = toml_machine(toml_text(machine.limits, machine.setup, tmp_path), "again.toml").machine()
    assert again.limits == machine.limits
    assert again.setup == machine.setup


def test_every_key(tmp_path):
    axes = ("X", "Y", "B", "W")
    limits = Limits(
        81.3,
        [1.1, 2.0, 0.3, 4.0],
        [10.0, 1e300, 3.3, 5e-9],
        [7.0, float("inf"), 1.0, 2.0],
        0.002,
        5e-4,
        900.1,
        7e4,
        axes,
        77.0,
    )
    setup = ProgramSetup(
        tmp_path / "shop" / 'a "b".tbl',
        {"X": 1.5, "B": 90.0},
        {"B": -12.25},
        {"W": 3.0},
        {"G54": {"X": 0.1, "B": 5.0}, "G59.1": {"Y": -7.0}},
    )
    text = toml_text(limits, setup, tmp_path, ["first", "second"], {("B", "jerk"): "said"})
    again = toml_machine(text, str(tmp_path / "again.toml")).machine()
    assert again.limits == limits
    assert again.setup == setup
    assert text.startswith("# first\n# second\nfeed_mm_s = 81.3\n")
    assert "jerk_rad_s3 = 1.0  # said\n" in text


def test_a_machine_of_another_format(tmp_path):
    (tmp_path / "grbl.txt").write_text("$110=6000\n$111=6000\n$120=350\n$121=300\nok\n")
    machine = read_machine(tmp_path / "grbl.txt", {"jerk_mm_s3": 5000.0})
    again = toml_machine(toml_text(machine.limits, machine.setup, PROJECT), "again.toml").machine()
    assert again.limits == machine.limits

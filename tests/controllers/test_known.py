"""The table of controllers."""

import pytest

from planner import InputError, read_program
from planner.controllers.known import controller_motion, known_controller


class TestNames:
    def test_unknown_controller(self):
        with pytest.raises(InputError, match="controller 'fanuc' must be one of"):
            known_controller("fanuc")

    def test_unknown_controller_for_a_program(self, tmp_path):
        path = tmp_path / "part.ngc"
        path.write_text("G21 G1 X10 F600\nM2\n")
        with pytest.raises(InputError, match="must be one of"):
            controller_motion(read_program(path), "", None)

    def test_no_program(self):
        with pytest.raises(InputError, match="program is a str"):
            controller_motion("part.ngc", "klipper", None)

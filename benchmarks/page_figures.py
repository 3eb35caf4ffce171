"""The picture of a report's page in docs/tutorial-shop.md: its playback, as a browser draws it.

    python -m benchmarks.page_figures [--output docs]

Needs Chromium (``apt-get install chromium``); the program and the machine are those of the tutorial.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.programs import FOLDER
from feedplan.job import load_job
from feedplan.page import write_report
from feedplan.playback import PlayedLines
from planner.machine.limits import Limits
from planner.programs.program_text import ProgramText

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
_MACHINE = Limits(
    80.0,
    [200.0, 200.0, 100.0],
    [800.0, 600.0, 400.0],
    [15000.0, 10000.0, 8000.0],
    chord_error=0.002,
    axes=("X", "Y", "Z"),
)
_TOLERANCE = 0.01  # mm
_TOOL = 1.25  # where the tool is drawn, s
_WINDOW = (1240, 1040)  # pixels of the page
_PART = (slice(258, 700), slice(40, 1215))  # of its rows and columns: path and playback


def playback_picture(file: Path) -> None:
    """Plan the slots, write the page, and save what the browser shows of path and playback."""
    from matplotlib.image import imread, imsave

    program = FOLDER / "slots.ngc"
    job = load_job(program, _MACHINE, tolerance=_TOLERANCE)
    verdict = job.run()
    played = PlayedLines.of(job, verdict.profile, ProgramText.read(program))
    with tempfile.TemporaryDirectory() as folder:
        page, picture = Path(folder) / "page.html", Path(folder) / "page.png"
        write_report(page, verdict, lines=job.line_times(verdict.profile), played=played)
        _photograph(page, picture, folder)
        pixels = np.asarray(imread(picture))[_PART]
    # 256 values a colour are enough, and a quarter of the size
    imsave(file, np.round(255.0 * pixels[..., :3]).astype(np.uint8), metadata={"Software": None})


def _photograph(page: Path, picture: Path, folder: str) -> None:
    browser = next(filter(None, map(shutil.which, _BROWSERS)), None)
    if browser is None:
        sys.exit("no Chromium is installed (apt-get install chromium)")
    width, height = _WINDOW
    command = [
        browser, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run",
        f"--user-data-dir={folder}/browser", f"--window-size={width},{height}", "--virtual-time-budget=1000",
        f"--screenshot={picture}", f"{page.as_uri()}#tool={_TOOL}",
    ]  # fmt: skip
    subprocess.run(command, check=True, capture_output=True, timeout=60)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--output", type=Path, default=Path("docs"))
    given = parser.parse_args(arguments)
    playback_picture(given.output / "page-playback.png")


if __name__ == "__main__":
    main()

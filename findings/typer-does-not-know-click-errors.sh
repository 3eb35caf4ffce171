#!/usr/bin/env bash
# typer 0.29.2, click 8.5.1, Python 3.11.
#
# typer was built on click for years, and a command could raise click.UsageError, or call a helper written for click that does:
# a usage message and exit status 2.  One would swear that it still is.  It is not: typer carries a copy of click inside
# (typer._click) and does not install click at all.  With click installed beside it, click's own errors are foreign to typer:
# click.UsageError in a command ends in a traceback and exit status 1; typer.BadParameter is a usage message and 2.
#
# Seen:  installed with typer: no click; click.UsageError: exit 1, traceback; typer.BadParameter: exit 2, usage
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
python="$work/venv/bin/python"
"$python" -m pip install -q typer==0.29.2
"$python" -c "import importlib.util, sys; sys.exit(importlib.util.find_spec('click') is not None)" || { echo "changed: typer installs click"; exit 1; }
"$python" -m pip install -q click==8.5.1

cat > "$work/cut.py" <<'PY'
import sys

import click
import typer

ERROR = {"click": click.UsageError, "typer": typer.BadParameter}[sys.argv.pop(1)]
app = typer.Typer(pretty_exceptions_enable=False)


@app.command()
def cut(feed: float) -> None:
    raise ERROR(f"feed {feed:g} must be > 0")


app()
PY
for of in click typer; do
  code=0
  "$python" "$work/cut.py" "$of" 5 > "$work/$of.txt" 2>&1 || code=$?
  kind=usage
  if grep -q Traceback "$work/$of.txt"; then kind=traceback; fi
  echo "error of $of: exit $code, $kind"
done | tee "$work/seen.txt"
diff <(printf 'error of click: exit 1, traceback\nerror of typer: exit 2, usage\n') "$work/seen.txt" > "$work/diff.txt" || { echo changed; exit 1; }

#!/usr/bin/env bash
# LinuxCNC 2.9.0~pre1 (Debian 12's linuxcnc-uspace, rs274).
#
# G5.2 begins a NURBS, the blocks after it are its control points, and G5.3 ends it.  Where the G5.3 is missing, one would swear that
# the program is refused, or that the spline is made when M2 comes.  It is accepted, exit status 0, without a word, and makes
# no motion at all: the cut is missing, and the machine stays where the spline would have begun.
#
# Seen:  with G5.3: 1 spline is cut;  without: 0, and no error
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
packages="linuxcnc-uspace=2.9.0~pre1+git20230208.f1270d6ed7-1+deb12u2 libboost-python1.74.0 libpython3.11 libpython3.11-stdlib
libpython3.11-minimal libedit2 libtirpc3 libbsd0 libmd0"
apt-get download -qq $packages 2> /dev/null
for package in *.deb; do dpkg -x "$package" root; done
export HOME="$work" LD_LIBRARY_PATH="root/usr/lib:root/usr/lib/x86_64-linux-gnu:root/lib:root/lib/x86_64-linux-gnu"

cat > closed.ngc <<'NGC'
G21 G90 G17
G0 X0 Y0
G5.2 X0 Y10 P1 L3 F100
X10 Y10 P1
X10 Y0 P1
G5.3
M2
NGC
grep -v G5.3 closed.ngc > open.ngc
touch tools variables
cuts() {
    root/usr/bin/rs274 -g -n 2 -t tools -v variables "$1" < /dev/null > canon.txt 2> log.txt
    grep -cE '(NURBS|STRAIGHT|ARC)_FEED\(' canon.txt || true
}
with=$(cuts closed.ngc)
without=$(cuts open.ngc)
echo "with G5.3: $with spline is cut;  without: $without, and no error"
[ "$with" = 1 ] && [ "$without" = 0 ]

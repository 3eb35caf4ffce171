"""LinuxCNC as the judge of the programs we write: its interpreter, and a headless run on a simulated machine.

LinuxCNC is an outside program here (Debian: ``apt-get install linuxcnc-uspace``); nothing of it is part of this.
"""

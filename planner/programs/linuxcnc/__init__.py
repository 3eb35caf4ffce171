"""Part programs as an installed LinuxCNC reads them: its interpreter makes the moves, and they are taken from there."""

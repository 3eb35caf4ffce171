"""Calibration against headless LinuxCNC: hidden limits found from traces and times, and the times of other programs."""

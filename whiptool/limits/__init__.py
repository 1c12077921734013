"""Limits that strikes have to keep: joints, motors, commands and clearance, and the order of their checks."""

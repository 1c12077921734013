"""Cameras: frames and their sources, calibration, a virtual camera, and tracking of markers."""

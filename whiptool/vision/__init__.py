"""Cameras: what a frame is, where frames come from, how a camera sees the strike plane, and a virtual camera."""

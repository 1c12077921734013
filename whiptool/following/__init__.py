"""Runs that are followed by their folders while they go on: how they converge, and their best strike so far."""

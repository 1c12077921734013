"""The rig: cameras that see the strike plane, and the tracking of whip tip and target in their images."""

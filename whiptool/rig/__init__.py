"""The rig: servos on a bus, their emulator, the control loop and its safety, and the records of strikes."""

"""The rig: servos on a bus, an emulator of them, the control loop and its safety, strikes and what they leave."""

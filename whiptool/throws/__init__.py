"""Throws: a thing at the tip or at the hand is released within the strike, flies, and has to enter a box."""

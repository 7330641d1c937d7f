"""Flights of a plan through drawn winds, and what they say of its promise."""

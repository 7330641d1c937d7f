"""A wind that is fitted in a moment, for tests that plan whole missions."""

QUICK_WIND = {"max_points": 40, "modes_max": 16, "spacing": 100e3, "modes_spacing": 100e3}

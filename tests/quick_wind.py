"""A wind whose fit takes little time, for tests that plan whole missions."""

QUICK_WIND = {"max_points": 40, "modes_max": 16, "spacing": 100e3, "modes_spacing": 100e3}


def wind_words() -> list[str]:
    """The same for the command line."""
    return [f"wind.{key}={value}" for key, value in QUICK_WIND.items()]

"""Questions before a flight: how much air it needs, and whether to go in this morning's forecast.

They take a finished plan and answer within seconds, by its own flights.
"""

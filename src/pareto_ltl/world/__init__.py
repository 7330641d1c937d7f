"""The map: scenes, polygons, cells."""

"""The map of a mission: scenes and their files, projection, polygons, cells of free space, random maps."""

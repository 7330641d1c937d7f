"""Lines on the map that complete the mission, before any refinement.

Orders of the mission's regions (``orders``), what the mission requires of each step (``obligations``), the
shortest line of a course around the corners of obstacles (``course``, ``taut_lines``;
``search_map`` simplifies outlines with many corners), and lines of every class: past each obstacle on either
side, through each landmark or none (``path_classes``, ``roadmap``, ``sights``).
"""

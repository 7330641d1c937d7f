"""False results: each lie edits the files of a correct result and names the claims that must fail.

Numbers that stand in several files are changed in all of them, so that only a second computation can find
the error.
"""

from lies.about_exports import EXPORT_LIES
from lies.about_pages import PAGE_LIES
from lies.about_plans import PLAN_LIES
from lies.about_runs import FLIGHT_LIES, RECORD_LIES, SEARCH_LIES
from lies.about_shapes import SHAPE_LIES
from lies.about_winds import ERROR_LIES, WIND_LIES
from lies.about_worlds import WORLD_LIES
from lies.editing import Lie, edited

LIES = (
    *PLAN_LIES,
    *WORLD_LIES,
    *WIND_LIES,
    *ERROR_LIES,
    *SEARCH_LIES,
    *FLIGHT_LIES,
    *RECORD_LIES,
    *EXPORT_LIES,
    *SHAPE_LIES,
    *PAGE_LIES,
)

__all__ = ["LIES", "Lie", "edited"]

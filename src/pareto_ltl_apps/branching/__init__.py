"""Plans that branch: after a position fix, the robot flies the table of the cell that it is measured in.

With ``branch.leaves`` above 1, the plan of a run gets branches before it is priced and written
(``additions``). ``stage`` finds the fix and the trunk, ``tree_search`` the cells and the rest of the plan in
each, ``bending`` a trunk that counts on its branches, and ``tree_plan`` makes the record, whose rates are of
flights of the whole tree (``tree_flights``). ``belief`` is what a cell tells of position, wind and the
robot's own errors.
"""

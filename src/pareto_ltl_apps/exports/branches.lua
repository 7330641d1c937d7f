-- Branches: at the time t of a fix the measured position selects a table. SCR_USER1 = 1, 2, ... selects the first, the
-- second, ...; with SCR_USER1 = 0 a satellite fix does. Without either until the time last, the plan goes on. A branch
-- that has branches is left at a second fix in the same way, by SCR_USER2.
-- A fix: times [s], the planned position [1e-7 deg], the planned track [deg]. A branch: name, from and to [m] ahead of
-- the planned position, from and to [m] left of the track, end [s], legs.
local ROOT = {
@TREE@
}
local PLAN, PLAN_END = LEGS, END
@REJOINED@
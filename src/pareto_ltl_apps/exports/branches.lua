-- Branches: at FIX.t the measured position selects a table. SCR_USER1 = 1, 2, ... selects the first, the second, ...;
-- with SCR_USER1 = 0 a satellite fix does. Without either until FIX.last, the plan goes on.
local FIX = { t = @T@, last = @LAST@, lat = @PLACE_LAT@, lng = @PLACE_LON@, track = @TRACK@ } -- [s], [s], [1e-7 deg], [deg]
local BRANCHES = { -- name, from and to [m] ahead of the planned position, from and to [m] left of the track, end [s], legs
@TABLES@
}
local PLAN, PLAN_END = LEGS, END

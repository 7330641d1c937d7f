-- What is added to the velocity through the air, to fly the distance from the planned position off and to go on
-- against the drift that it tells of: the distance north and east [m], and its part for each second [1/s], of the legs
-- that begin before the time last [s] and of later ones.
local change = nil

-- Airspeed and heading of a leg that begins at time, with the change.
local function rejoined(time, airspeed, heading)
    local rate = change and (time < change.last and change.first or change.later) or 0
    if rate == 0 then
        return airspeed, heading
    end
    local size, angle = heading < 0 and 0 or RATIO * airspeed, math.rad(math.max(heading, 0))
    local north, east = size * math.cos(angle) - rate * change.north, size * math.sin(angle) - rate * change.east
    local wanted = math.sqrt(north * north + east * east)
    return math.min(math.max(wanted, SLOWEST), FASTEST) / RATIO, math.deg(math.atan(east, north)) % 360
end

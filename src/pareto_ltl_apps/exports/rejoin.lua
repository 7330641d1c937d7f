-- What is added to the velocity through the air, to fly off the distance from the planned position: north and east
-- [m/s], until a time [s]; of the legs that begin before it.
local change = nil

-- Airspeed and heading of a leg that begins at time, with the change.
local function rejoined(time, airspeed, heading)
    if change == nil or time >= change.last then
        return airspeed, heading
    end
    local size, angle = heading < 0 and 0 or RATIO * airspeed, math.rad(math.max(heading, 0))
    local north, east = size * math.cos(angle) + change.north, size * math.sin(angle) + change.east
    local wanted = math.sqrt(north * north + east * east)
    return math.min(math.max(wanted, SLOWEST), FASTEST) / RATIO, math.deg(math.atan(east, north)) % 360
end

-- The branch of a satellite fix, by its distances along the planned track and to its left; nil without a fix.
local function measured_branch()
    if gps:status(0) < FIX_3D then
        return nil
    end
    local place = Location()
    place:lat(FIX.lat)
    place:lng(FIX.lng)
    local off, track = place:get_distance_NE(gps:location(0)), math.rad(FIX.track)
    local along = off:x() * math.cos(track) + off:y() * math.sin(track)
    local left = off:x() * math.sin(track) - off:y() * math.cos(track)
    for number, one in ipairs(BRANCHES) do
        if along >= one.along[1] and along < one.along[2] and left >= one.left[1] and left < one.left[2] then
            return number
        end
    end
    return nil
end

local chosen = false

local function choose(time)
    if chosen or time < FIX.t or time > FIX.last then
        return
    end
    local asked = math.floor(param:get("SCR_USER1") or 0)
    local number = BRANCHES[asked] and asked or measured_branch()
    if number ~= nil then
        chosen, LEGS, END, leg = true, BRANCHES[number].legs, BRANCHES[number].t_end, 0
        say(INFO, "branch " .. BRANCHES[number].name)
    end
end


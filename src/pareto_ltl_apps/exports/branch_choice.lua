-- The distance of a satellite fix from the planned position; nil without a fix.
local function measured_distance(node)
    if gps:status(0) < FIX_3D then
        return nil
    end
    local place = Location()
    place:lat(node.fix.lat)
    place:lng(node.fix.lng)
    return place:get_distance_NE(gps:location(0))
end

-- The branch of a distance, by its parts along the planned track and to its left; nil without a distance.
local function measured_branch(node, off)
    if off == nil then
        return nil
    end
    local track = math.rad(node.fix.track)
    local along = off:x() * math.cos(track) + off:y() * math.sin(track)
    local left = off:x() * math.sin(track) - off:y() * math.cos(track)
    for number, one in ipairs(node.branches) do
        if along >= one.along[1] and along < one.along[2] and left >= one.left[1] and left < one.left[2] then
            return number
        end
    end
    return nil
end

local here, level = ROOT, 1 -- the next fix, and its number

local function choose(time)
    if here.fix == nil or time < here.fix.t or time > here.fix.last then
        return
    end
    local asked = math.floor(param:get("SCR_USER" .. level) or 0)
    local off = measured_distance(here)
    local number = here.branches[asked] and asked or measured_branch(here, off)
    if number ~= nil then
@REJOIN@        here, level = here.branches[number], level + 1
        LEGS, END, leg = here.legs, here.t_end, 0
        say(INFO, "branch " .. here.name)
    end
end


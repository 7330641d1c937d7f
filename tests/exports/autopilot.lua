-- What plan.lua uses of ArduPilot's API, and a flight: arg[1] is the script, arg[2] a Lua table of events.
-- Prints each command that is accepted, and each text.
local now, armed, mode, fix, denied = 0, false, 10, 0, {}
local sent = {}

local uint = {}
uint.__index = uint
uint.__sub = function(a, b) return setmetatable({ v = a.v - b.v }, uint) end
function uint:tofloat() return self.v end

function millis() return setmetatable({ v = now }, uint) end
arming = { is_armed = function() return armed end }
vehicle = { get_mode = function() return mode end }
local user, second, measured = 0, 0, nil
gps = {
    status = function(_, instance) return instance == 0 and fix or nil end,
    location = function() return measured end,
}
param = { get = function(_, name) return ({ SCR_USER1 = user, SCR_USER2 = second })[name] end }

local function field(name)
    return function(self, value)
        if value ~= nil then
            assert(math.type(value) == "integer", name .. " must be an integer")
            self["_" .. name] = value
        end
        return self["_" .. name]
    end
end
local RADIUS = 6371008.8 -- [m] of a sphere, close enough for the few km of a test
function Location()
    return {
        lat = field("lat"), lng = field("lng"), alt = field("alt"),
        get_distance_NE = function(self, other)
            local degree = math.pi / 180 * 1e-7 * RADIUS
            local middle = math.rad(1e-7 * (self:lat() + other:lat()) / 2)
            local north = degree * (other:lat() - self:lat())
            local east = degree * (other:lng() - self:lng()) * math.cos(middle)
            return { x = function() return north end, y = function() return east end }
        end,
    }
end

local origin
local function place(loc) return string.format("%d %d %d", loc:lat(), loc:lng(), loc:alt()) end
ahrs = {
    initialised = function() return true end,
    get_origin = function() return origin end,
    set_origin = function(_, loc) origin = loc; print("origin " .. place(loc)); return true end,
    set_home = function(_, loc) print("home " .. place(loc)); return true end,
    handle_external_position_estimate = function(_, loc, sd, at)
        assert(at:tofloat() == now)
        print(string.format("position %s %.1f", place(loc), sd))
        return true
    end,
}
gcs = {
    send_text = function(_, severity, text) print("text " .. severity .. " " .. text) end,
    run_command_int = function(_, command, p)
        if (command == 43000 or command == 43002) and not (armed and mode == 15) then error("sent outside of GUIDED") end
        if denied[command] then return 4 end
        print(string.format("%.1f %d %.9g %.9g %.9g", now / 1000, command, p.p1, p.p2, p.p3))
        return 0
    end,
}

local update, wait = dofile(arg[1])
local events = load("return " .. arg[2])()
for _, event in ipairs(events) do
    while now < 1000 * event.t do
        update, wait = update()
        now = now + wait
    end
    if event.armed ~= nil then armed = event.armed end
    if event.mode then mode = event.mode end
    if event.fix then fix = event.fix end
    if event.user then user = event.user end
    if event.second then second = event.second end
    if event.lat then
        measured = Location()
        measured:lat(event.lat)
        measured:lng(event.lng)
    end
    if event.deny ~= nil then denied[event.deny] = true end
    if event.take ~= nil then denied[event.take] = nil end
end

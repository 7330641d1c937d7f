--[[
@TEXT@

Flies the table below by the clock: ArduPlane 4.6 or later, SCR_ENABLE = 1, this file in APM/scripts of the card.

The departure is the first moment at which the aeroplane is armed and in GUIDED; it should then be at the start of
the plan. At each leg the wind, the airspeed and the heading are set, and again until the autopilot accepts them.
Outside of GUIDED nothing is set while the clock goes on; disarming ends the flight. The script never arms,
disarms or changes a mode, and it sets no height. After the last leg the last heading is held: choose a mode.

Before the departure the wind of the first leg is set. ArduPilot gives winds to DCM only, not to EKF3: they help an
aeroplane that flies by DCM.

Without a satellite fix the script gives the autopilot the start of the plan as its origin, its home and its position
before the departure. For that it needs the height of the ground there: set GROUND.
]]

local GROUND = nil -- [m] above mean sea level at the start of the plan; nil: origin, home and position are left alone
local START = { lat = @LAT@, lng = @LON@, sd = @SD@ } -- [1e-7 deg], [1e-7 deg], [m]
local END = @END@ -- [s] after the departure
local TURN = @TURN@ -- [m/s/s] centripetal acceleration of turns
local LEGS = { -- time [s], calibrated airspeed [m/s], true heading [deg], wind speed [m/s], its sd, wind from [deg], its sd
@LEGS@
}
@BRANCHES@
local GUIDED, FIX_3D, GLOBAL = 15, 3, 0
local SPEED, HEADING, WIND = 43000, 43002, 43004
local PERIOD = 200 -- [ms]
local WARNING, INFO = 4, 6

local begun, leg, waiting, warned, prepared, over = nil, 0, {}, false, false, false
local winded = false -- whether the wind of the first leg was taken before the departure

local function say(severity, text)
    gcs:send_text(severity, "plan: " .. text)
end

-- Before the departure: origin, home and position, where there is no satellite fix.
local function prepare()
    if prepared or GROUND == nil or gps:status(0) >= FIX_3D or not ahrs:initialised() then
        return
    end
    local start = Location()
    start:lat(START.lat)
    start:lng(START.lng)
    start:alt(math.floor(100 * GROUND))
    if not ahrs:get_origin() and not ahrs:set_origin(start) then
        return
    end
    prepared = ahrs:set_home(start)
    if prepared then
        local placed = ahrs:handle_external_position_estimate(start, START.sd, millis())
        say(INFO, "origin and home set" .. (placed and ", and the position" or ""))
    end
end

local function commands_of(number)
    local _, airspeed, heading, wind, wind_sd, from, from_sd = table.unpack(LEGS[number])
@CHANGED@    local all = { { SPEED, { p1 = 0, p2 = airspeed, p3 = 0 } } }
    if heading >= 0 then
        all[#all + 1] = { HEADING, { frame = GLOBAL, p1 = 1, p2 = heading, p3 = TURN } }
    end
    if wind_sd > 0 then
        all[#all + 1] = { WIND, { p1 = wind, p2 = wind_sd, p3 = from, p4 = from_sd } }
    end
    return all
end

-- On the ground: the wind of the first leg.
local function set_first_wind()
    for _, one in ipairs(winded and {} or commands_of(1)) do
        if one[1] == WIND then
            winded = gcs:run_command_int(one[1], one[2]) == 0
        end
    end
end

-- Send what is not accepted yet.
local function send()
    local left = {}
    for _, one in ipairs(waiting) do
        if gcs:run_command_int(one[1], one[2]) ~= 0 then
            left[#left + 1] = one
        end
    end
    waiting = left
    if #waiting > 0 and not warned then
        warned = true
        say(WARNING, "command " .. waiting[1][1] .. " is not accepted; it is sent again")
    end
end

@CHOOSER@local function update()
    if not arming:is_armed() then
        begun, leg, waiting, over = nil, 0, {}, false
@RESET@        prepare()
        set_first_wind()
        return update, PERIOD
    end
    local guided = vehicle:get_mode() == GUIDED
    if begun == nil then
        if not guided then
            return update, PERIOD
        end
        begun = millis()
        say(INFO, "departure, " .. #LEGS .. " legs")
    end
    local time = (millis() - begun):tofloat() * 0.001
    if over or time >= END then
        if not over then
            over = true
            say(WARNING, "the plan has ended; choose a mode")
        end
        return update, PERIOD
    end
@CHOOSE@    local now = math.max(leg, 1)
    while now < #LEGS and time >= LEGS[now + 1][1] do
        now = now + 1
    end
    if not guided then
        leg = 0 -- the leg of that time is set when GUIDED is chosen again
        return update, PERIOD
    end
    if now ~= leg then
        leg, warned = now, false
        waiting = commands_of(leg)
    end
    send()
    return update, PERIOD
end

return update, PERIOD

        change = nil
        if here.fix.rejoin > 0 and off == nil then
            say(WARNING, "no position: the distance from the planned one is not flown off")
        elseif here.fix.rejoin > 0 then
            local rate = -1 / here.fix.rejoin
            change = { north = rate * off:x(), east = rate * off:y(), last = here.fix.t + here.fix.rejoin }
        end

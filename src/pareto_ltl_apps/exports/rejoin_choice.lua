        change = nil
        if here.fix.rejoin > 0 and off == nil then
            say(WARNING, "no position: the distance from the planned one is not flown off")
        elseif here.fix.rejoin > 0 then
            local first, later = 1 / here.fix.rejoin + here.fix.counter, here.fix.counter
            local last = here.fix.t + here.fix.rejoin
            change = { north = off:x(), east = off:y(), first = first, later = later, last = last }
        end

// The time of a flight: the slider `time` with its text `clock`, and the button `play`.

import { byId } from "./shapes.js";

const CALM = matchMedia("(prefers-reduced-motion: reduce)").matches;
const FLIGHT = 9000;  // [ms] that a whole flight takes
const PICTURES = 150;  // of it, at most
const PAUSES = CALM ? [600, 600] : [60, 300];  // [ms] between two pictures, least and most

export class Player {
  /** `show(step)` shows a step and returns its time in words. */
  constructor(show) {
    Object.assign(this, { show, timer: null, step: 0 });
    byId("time").addEventListener("input", event => { this.stop(); this.go(+event.target.value); });
    byId("play").addEventListener("click", () => (this.timer === null ? this.play() : this.stop()));
  }

  get last() { return +byId("time").max; }

  /** Set the number of the last step; the present one stays if it exists. */
  limit(last) {
    this.stop();
    byId("time").max = last;
    byId("time").disabled = byId("play").disabled = last < 1;
    byId("time").value = this.step = Math.min(this.step, last);
  }

  go(step) {
    byId("time").value = this.step = step;
    const text = this.show(step);
    byId("clock").textContent = text;
    byId("time").setAttribute("aria-valuetext", text);
  }

  play() {
    if (this.step >= this.last) this.go(0);
    this.mark("❚❚", "pause");
    const stride = Math.max(1, Math.round(this.last / PICTURES)), [least, most] = PAUSES;
    this.timer = setInterval(() => {
      this.go(Math.min(this.last, this.step + stride));
      if (this.step >= this.last) this.stop();
    }, Math.max(least, Math.min(most, FLIGHT * stride / this.last)));
  }

  stop() {
    clearInterval(this.timer);
    this.timer = null;
    this.mark("▶", "play");
  }

  mark(sign, name) {
    byId("play").textContent = sign;
    byId("play").setAttribute("aria-label", name);
    byId("play").setAttribute("aria-pressed", String(name === "pause"));
  }
}

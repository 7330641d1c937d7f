// Reactions to choices, to the slider and to play; and the first drawing: the map, then the visible charts.

/** Show a point in all parts of the page. */
function showPoint(point) {
  if (point === null || !(point in PAGE.points)) return;
  stop();
  const there = String(point) in PAGE.paths;
  shown.point = point;
  shown.step = 0;
  byId("point").value = point;
  byId("previous").disabled = point === 0;
  byId("next").disabled = point === PAGE.points.length - 1;
  byId("home").disabled = point === PAGE.chosen || PAGE.chosen === null;
  if (!there) byId("map-note").textContent = `The path of point ${point} is not in this page: pareto-ltl choose DIR --point ${point} makes it the plan.`;
  else mapNote();
  limitTime();
  showFacts();
  if (there) restyleMap({ ...pathTraces(), ...placeTraces(), ...momentTraces() });
  else restyleMap({ path: { x: [], y: [], text: [] }, ends: { x: [], y: [] }, ellipses: { x: [], y: [], visible: true }, ...placeTraces(), ...momentTraces() });
  redrawSeen();
  listProgress();
  showMoment();
}

/** The numbers at the top: as they were written for the plan, or those of another point that is shown. */
function showFacts() {
  const place = byId("facts"), note = byId("facts-note");
  if (!place) return;
  showFacts.plan ??= [...place.children];
  note.hidden = shown.point === PAGE.chosen || PAGE.chosen === null;
  if (note.hidden) { place.replaceChildren(...showFacts.plan); return; }
  const row = PAGE.points[shown.point], way = path(), utc = way?.utc?.at(-1);
  const rate = row.low === null ? [`≤ ${percent(row.failure)}`, `upper bound, under ${row.law} winds`] : [percent(row.failure), `${percent(row.low)} to ${percent(row.high)} (95 %), under ${row.law} winds, ${row.runs.toLocaleString("en")} flights`];
  const facts = [["fails", ...rate], ["length", distance(row.length), "of the expected path"], ["duration", duration(row.duration), `${row.steps} steps`]];
  if (utc) facts.push(["arrival", `${utc.slice(11, 16)} UTC`, utc.slice(0, 10)]);
  facts.push(["shown", `point ${shown.point}`, [`of the front, not the plan (point ${PAGE.chosen})`, ...row.costs].join("; ")]);
  place.replaceChildren(...facts.map(([name, value, told], k) => {
    const made = element("div", { class: k ? "fact" : "fact main" }), number = element("dd", {}, value);
    number.append(element("small", {}, told));
    made.append(element("dt", {}, name), number);
    return made;
  }));
  note.textContent = `These are the numbers of point ${shown.point}. The sections “How often it fails” and “What limits it” are about the plan, point ${PAGE.chosen}.`;
}

/** Draw again the charts that have been drawn; the others are drawn when they become visible. */
function redrawSeen() {
  if (drawn.has("front")) markFront();
  if (drawn.has("risk")) drawRisk();
  if (drawn.has("files")) listFiles();
}

function limitTime() {
  const way = path(), slider = byId("time"), last = (way ? way.x.length : PAGE.wind.t.length) - 1;
  slider.max = last;
  slider.value = shown.step = Math.min(shown.step, last);
  slider.disabled = byId("play").disabled = last < 1;
}

/** The time of the slider, on the map and in the other charts. */
function showStep(step) {
  shown.step = step;
  byId("time").value = step;
  restyleMap(momentTraces());
  if (drawn.has("risk")) markRisk();
  showMoment();
}

/** The time and the state of the flight in words. */
function showMoment() {
  const way = path(), seconds = way ? way.t[shown.step] : PAGE.wind.t[shown.step] ?? 0;
  byId("clock").textContent = timeText(seconds);
  byId("time").setAttribute("aria-valuetext", byId("clock").textContent);
  if (way) byId("moment").textContent = momentText(way);
  markMachine();
}

function momentText(way) {
  const k = shown.step, { failed, runs, law } = way.risk, count = failed.reduce((sum, cause) => sum + cause[k], 0);
  const told = [`Step ${k} of ${way.x.length - 1}, ${duration(way.t[k])} after departure`];
  if (way.label[k].length) told[0] += `, in ${way.label[k].join(", ")}`;
  if (way.log) told.push(`95 % of positions within ${distance(way.log.radius[k])}`);
  told.push(`${count} of ${runs} flights (${percent(count / runs)}) have failed so far under ${law} winds`);
  return `${told.join("; ")}.`;
}

// --- playing ------------------------------------------------------------------------------------

function stop() {
  clearInterval(shown.timer);
  shown.timer = null;
  byId("play").textContent = "▶";
  byId("play").setAttribute("aria-label", "play");
  byId("play").setAttribute("aria-pressed", "false");
}

function play() {
  if (shown.timer !== null) { stop(); return; }
  const last = +byId("time").max;
  if (shown.step >= last) showStep(0);
  byId("play").textContent = "❚❚";
  byId("play").setAttribute("aria-label", "pause");
  byId("play").setAttribute("aria-pressed", "true");
  const pause = CALM ? 600 : Math.max(60, Math.min(250, 9000 / last));  // a flight takes about nine seconds
  shown.timer = setInterval(() => {
    showStep(Math.min(last, shown.step + Math.max(1, Math.round(last / 150))));
    if (shown.step >= last) stop();
  }, pause);
}

// --- the first picture -----------------------------------------------------------------------------

const drawn = new Set();
const LATER = { front: drawFront, risk: drawRisk, machine: () => { drawMachine(); markMachine(); }, files: listFiles };

/** Give each chart the size of its place at once: for printing nothing can be drawn later. */
function fitCharts() {
  fitMap();
  for (const chart of document.querySelectorAll(".js-plotly-plot")) Plotly.relayout(chart, { width: chart.clientWidth, height: chart.clientHeight });
}

/** Lay the page out for printing, and back for the window: a printed chart keeps the size in which it was drawn. */
function fitPaper(draw) {
  addEventListener("beforeprint", () => {
    document.documentElement.classList.add("printing");
    for (const id of Object.keys(LATER)) if (byId(id)) draw(id);
    fitCharts();
  });
  addEventListener("afterprint", () => {
    document.documentElement.classList.remove("printing");
    fitMap();
    for (const chart of document.querySelectorAll(".js-plotly-plot")) Plotly.relayout(chart, { autosize: true, width: null, height: null });
  });
}

/** Draw each part when it comes near the window; all of it before the page is printed. */
function drawWhenSeen() {
  const draw = id => {
    if (drawn.has(id)) return;
    drawn.add(id);
    LATER[id]();
  };
  const watcher = new IntersectionObserver(entries => {
    for (const entry of entries) if (entry.isIntersecting) { watcher.unobserve(entry.target); draw(entry.target.id); }
  }, { rootMargin: "200px" });
  for (const id of Object.keys(LATER)) if (byId(id)) watcher.observe(byId(id));
  fitPaper(draw);
}

function fillChooser() {
  const select = byId("point");
  if (!select) return;
  PAGE.points.forEach((row, k) => {
    const named = `point ${k}: ${distance(row.length)}, ${failureText(row)}${k === PAGE.chosen ? " (chosen)" : ""}`;
    select.append(element("option", { value: k }, named));
  });
  select.value = shown.point;
  select.addEventListener("change", () => showPoint(+select.value));
  byId("previous").addEventListener("click", () => showPoint(shown.point - 1));
  byId("next").addEventListener("click", () => showPoint(shown.point + 1));
  byId("home").addEventListener("click", () => showPoint(PAGE.chosen));
  byId("previous").disabled = shown.point === 0;
  byId("next").disabled = shown.point === PAGE.points.length - 1;
  byId("home").disabled = true;
}

function mapNote() {
  const told = [];
  if (PAGE.flights) told.push(`${PAGE.flights.x.length} of ${PAGE.flights.runs.toLocaleString("en")} simulated flights of the chosen plan are drawn, as they come, under ${PAGE.flights.law} winds; those that have failed are dashed and dark red, with a cross.`);
  if (PAGE.law && path()) told.push(`Ellipses hold 95 % of positions at a time under ${PAGE.law} winds.`);
  told.push(fastest ? `Wind at ${PAGE.wind.level}; the longest arrow is ${fastest.toFixed(1)} m/s.` : "Calm air.", PAGE.map.walled ? "The border is a wall: leaving the map is a failure." : "The border is open.");
  for (const { name, forbidden, told: when } of PAGE.map.windows) told.push(`${forbidden ? "Forbidden" : `${name} holds`} ${when}.`);
  if (PAGE.map.windows.some(w => w.forbidden)) told.push("What is forbidden at the time of the slider is dark, with a dashed outline.");
  if (PAGE.trees.length) told.push("Grey lines: the oldest branches of the search trees, as far as they came.");
  byId("map-note").textContent = told.join(" ");
}

function hideUseless() {
  if (!PAGE.flights) for (const part of [byId("flights-label"), ...document.querySelectorAll(".flight-key")]) part.remove();
  if (!path()) {
    for (const sign of [".end", ".way", ".robot"]) document.querySelector(`.key${sign}`).parentElement.remove();
    byId("show-ellipses").parentElement.remove();
    byId("moment").remove();
  }
  if (!PAGE.onEarth) byId("export-command")?.parentElement.remove();
  if (!(PAGE.places.length || PAGE.pricedObstacles.length) || PAGE.chosen === null) for (const id of ["places-label", "places-key"]) byId(id).remove();
  if (!PAGE.map.landmarks.length) byId("landmark-key").remove();
  if (!PAGE.map.obstacles.length) document.querySelector(".key.obstacle").parentElement.remove();
  if (Object.keys(PAGE.paths).length < 2) byId("others-label").remove();
}

function begin() {
  hideUseless();
  limitTime();
  byId("time").addEventListener("input", event => { stop(); showStep(+event.target.value); });
  byId("play").addEventListener("click", play);
  fillChooser();
  mapNote();
  drawMap().then(chart => {
    chart.on("plotly_click", event => {
      const on = event.points.find(point => point.curveNumber === traceNumber("path"));
      const reason = event.points.find(point => point.curveNumber === traceNumber("reasons"));
      if (on || reason) { stop(); showStep(on ? on.pointNumber : reason.customdata); }
    });
    for (const box of document.querySelectorAll(".layers input")) box.addEventListener("change", () => restyleMap({ ...pathTraces(), ...placeTraces(), ...momentTraces() }));
    document.documentElement.dataset.ready = "map";
    listProgress();
    showMoment();
    drawWhenSeen();
  });
}

begin();

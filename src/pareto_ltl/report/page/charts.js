// The front, failure against length, and the risk along the path of the point that is shown.

/** The largest number 1, 2 or 5 times a power of ten that is at most `value`. */
function roundBelow(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [5, 2, 1].find(m => m === 1 || m * power <= value * (1 + 1e-9));
}

/** The lower end of the axis of failures; smaller ones, and 0, are drawn there. */
const failureEnd = (() => {
  const wanted = PAGE.points.map(row => row.failure > 0 ? Math.max(row.low ?? 0, row.failure / 5) : (row.high ?? 1e-3) / 5);
  return roundBelow(Math.max(1e-9, wanted.reduce((a, b) => Math.min(a, b), 1)));
})();

const atLeast = p => 100 * Math.max(p, failureEnd);
const lengthUnit = PAGE.points.some(row => row.length >= 2000) ? ["km", 1e-3] : ["m", 1];

function pointText(row, k) {
  const told = [`point ${k}${k === PAGE.chosen ? ", the chosen plan" : ""}`, failureText(row), `${distance(row.length)}, ${duration(row.duration)}`];
  told.push(...row.costs);
  if (row.order) told.push(plain(row.order));
  return told.join("<br>");
}

/** Ticks at 1, 2 and 5 times powers of ten, few enough to be read. */
function failureTicks(low, high) {
  const steps = Math.log10(high / low) > 2.2 ? [1] : [1, 2, 5], found = [];
  for (let power = -9; power <= 2; power++) for (const m of steps) {
    const value = m * 10 ** power;
    if (value >= low * 0.999 && value <= high * 1.001) found.push(+value.toPrecision(3));
  }
  return found;
}

function drawFront() {
  const rows = PAGE.points, x = rows.map(row => row.length * lengthUnit[1]), y = rows.map(row => atLeast(row.failure));
  const ranged = rows.map((row, k) => row.low === null ? [0, 0] : [atLeast(row.high) - y[k], y[k] - atLeast(row.low)]);
  const law = PAGE.points[0].law, told = k => String(k) in PAGE.paths;
  const bound = PAGE.judge === "bound";
  const traces = [
    { x, y, mode: "markers", cliponaxis: false, text: rows.map(pointText), hovertemplate: "%{text}<extra></extra>", showlegend: false,
      marker: { size: 9, color: rows.map((row, k) => told(k) ? COLOURS.flight : COLOURS.paper), symbol: rows.map(row => row.failure < failureEnd ? "triangle-down-open" : "circle"), line: { color: COLOURS.flight, width: 1.5 } },
      error_y: { type: "data", visible: !bound, symmetric: false, array: ranged.map(r => r[0]), arrayminus: ranged.map(r => r[1]), color: COLOURS.flight, thickness: 1, width: 3 } },
    { ...ringAt(PAGE.chosen), mode: "markers", hoverinfo: "skip", name: "chosen plan", marker: { size: 19, symbol: "diamond-open", color: COLOURS.chosen, line: { width: 2.2 } }, visible: PAGE.chosen !== null },
    { ...ringAt(shown.point), mode: "markers", hoverinfo: "skip", name: "shown", marker: { size: 17, symbol: "circle-open", color: COLOURS.path, line: { width: 2.4 } } },
  ];
  const hidden = rows.some(row => row.failure < failureEnd || row.low === 0);
  const highest = Math.min(100, rows.reduce((most, row) => Math.max(most, atLeast(row.high ?? row.failure)), 0)), ticks = failureTicks(100 * failureEnd, highest * 1.6);
  if (hidden && ticks[0] > 100.1 * failureEnd) ticks.unshift(100 * failureEnd);
  const layout = {
    font: FONT, plot_bgcolor: COLOURS.paper, paper_bgcolor: COLOURS.paper, margin: { l: 62, r: 10, t: 30, b: 44 }, hovermode: "closest", dragmode: false, legend: { orientation: "h", x: 1, xanchor: "right", y: 1.0, yanchor: "bottom" },
    xaxis: { title: { text: `length [${lengthUnit[0]}]`, standoff: 6 }, zeroline: false, gridcolor: COLOURS.grid },
    yaxis: { type: "log", title: { text: bound ? `upper bound, ${plain(law)} winds [%]` : `fails, ${plain(law)} winds [%]`, standoff: 4 }, tickvals: ticks, ticktext: ticks.map((tick, k) => k === 0 && hidden ? "0" : String(tick)), gridcolor: COLOURS.grid, range: [Math.log10(100 * failureEnd) - 0.08, Math.log10(highest * 1.35)] },
  };
  Plotly.newPlot("front", traces, layout, CONFIG).then(chart => {
    chart.on("plotly_click", event => showPoint(nearestPoint(event)));
  });
  byId("front-note").textContent = bound
    ? `Each point is a path; its bound on failure holds under ${law} winds. Click a point to see it.`
    : `Each point is a path with the failure rate of its ${rows[0].runs.toLocaleString("en")} flights under ${law} winds and its 95 % interval. Click a point to see it.`;
}

/** The point of a click: the number of the marker, also where another mark covers it. */
function nearestPoint(event) {
  const found = event.points.find(point => point.curveNumber === 0) ?? event.points[0];
  return found.curveNumber === 0 ? found.pointNumber : shown.point;
}

function ringAt(point) {
  if (point === null) return { x: [], y: [] };
  const row = PAGE.points[point];
  return { x: [row.length * lengthUnit[1]], y: [atLeast(row.failure)] };
}

function markFront() {
  const ring = ringAt(shown.point);
  Plotly.restyle("front", { x: [ring.x], y: [ring.y] }, [2]);
}

// --- risk along the path -----------------------------------------------------------------------

const CAUSE_DASHES = ["dash", "dot", "dashdot", "longdash"];
const CAUSE_COLOURS = DARK ? ["#f0e442", "#d55e00", "#b0b8ff", "#4f6fd8"] : ["#4d4d4d", "#a0457f", "#009e73", "#0072b2"];

function riskTraces(way) {
  const { failed, runs, low, high } = way.risk, unit = timeUnit(way), x = way.t.map(t => t / unit.seconds);
  const total = x.map((_, k) => failed.reduce((sum, cause) => sum + cause[k], 0));
  const share = counts => counts.map(n => 100 * n / runs), step = { shape: "hv" };
  const traces = [
    { x, y: low.map(p => 100 * p), mode: "lines", line: { ...step, width: 0 }, hoverinfo: "skip", showlegend: false },
    { x, y: high.map(p => 100 * p), mode: "lines", line: { ...step, width: 0 }, fill: "tonexty", fillcolor: "rgba(200,60,90,0.14)", hoverinfo: "skip", showlegend: false },
    { x, y: share(total), mode: "lines+markers", marker: { size: x.map((_, k) => k === x.length - 1 ? 8 : 0.1), color: COLOURS.failed }, line: { ...step, color: COLOURS.failed, width: 2.6 }, name: "failed", text: total, hovertemplate: `%{text} of ${runs} flights (%{y:.2g} %) have failed<extra></extra>` },
  ];
  failed.forEach((counts, cause) => {
    if (!counts[counts.length - 1]) return;
    traces.push({ x, y: share(counts), mode: "lines", line: { ...step, color: CAUSE_COLOURS[cause], dash: CAUSE_DASHES[cause], width: 1.6 }, name: PAGE.causes[cause], hoverinfo: "skip" });
  });
  return [traces, unit];
}

function riskLayout(way, unit) {
  const top = 100 * Math.max(...way.risk.high) * 1.1;
  return {
    font: FONT, plot_bgcolor: COLOURS.paper, paper_bgcolor: COLOURS.paper, margin: { l: 62, r: 10, t: 44, b: 44 }, hovermode: "x", dragmode: false, showlegend: true, legend: { orientation: "h", x: 0, y: 1.0, yanchor: "bottom", font: { size: 11 } },
    xaxis: { title: { text: `${unit.name} after departure`, standoff: 6 }, zeroline: false, gridcolor: COLOURS.grid, range: [0, 1.03 * way.t[way.t.length - 1] / unit.seconds] },
    yaxis: { title: { text: `failed by then, ${plain(way.risk.law)} winds [%]`, standoff: 4, font: { size: 11 } }, range: [0, Math.min(100, top)], gridcolor: COLOURS.grid }, shapes: [nowLine(way, unit)],
  };
}

const nowLine = (way, unit) => {
  const x = way.t[shown.step] / unit.seconds;
  return { type: "line", yref: "paper", y0: 0, y1: 1, x0: x, x1: x, line: { color: COLOURS.chosen, width: 2 } };
};

function drawRisk() {
  const way = path();
  if (!way) {
    Plotly.purge("risk");
    byId("risk-note").textContent = `The flights of point ${shown.point} are not in this page.`;
    return;
  }
  const [traces, unit] = riskTraces(way);
  Plotly.react("risk", traces, riskLayout(way, unit), CONFIG);
  const total = way.risk.failed.reduce((sum, cause) => sum + cause[cause.length - 1], 0);
  byId("risk-note").textContent = `${total.toLocaleString("en")} of ${way.risk.runs.toLocaleString("en")} simulated flights of this point fail under ${way.risk.law} winds; the band is the 95 % interval. `
    + "Whether a mission was missed is known at its end. The flights of all points meet the same winds.";
}

function markRisk() {
  const way = path();
  if (way) Plotly.relayout("risk", { shapes: [nowLine(way, timeUnit(way))] });
}

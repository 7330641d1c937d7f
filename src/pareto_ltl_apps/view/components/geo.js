// Places on the Earth or in a plane: what the map shows them in, distances, degrees as text, names of regions.

export const EARTH = 6371008.8;  // mean radius [m]
const RAD = Math.PI / 180;
const MOST_LAT = 85;

export const mercator = ([lon, lat]) => [lon * RAD, Math.asinh(Math.tan(Math.max(-MOST_LAT, Math.min(MOST_LAT, lat)) * RAD))];
export const degrees = ([x, y]) => [x / RAD, Math.atan(Math.sinh(y)) / RAD];

/** Distance [m] along a great circle. */
export function distance([a, b], [c, d]) {
  const half = Math.sin((d - b) * RAD / 2) ** 2 + Math.cos(b * RAD) * Math.cos(d * RAD) * Math.sin((c - a) * RAD / 2) ** 2;
  return 2 * EARTH * Math.asin(Math.sqrt(half));
}

/** The place at a distance [m] from another, in a direction clockwise from north [rad]. */
export function beside([lon, lat], metres, direction) {
  const arc = metres / EARTH, from = lat * RAD;
  const to = Math.asin(Math.sin(from) * Math.cos(arc) + Math.cos(from) * Math.sin(arc) * Math.cos(direction));
  const turn = Math.atan2(Math.sin(direction) * Math.sin(arc) * Math.cos(from), Math.cos(arc) - Math.sin(from) * Math.sin(to));
  return [lon + turn / RAD, to / RAD];
}

/** Round numbers 1, 2 and 5 times powers of ten: the least one that is at least `least`. */
export function roundAbove(least) {
  const power = 10 ** Math.floor(Math.log10(least));
  return power * [1, 2, 5, 10].find(m => m * power >= least * (1 - 1e-9));
}

/** Round numbers between two ends, about `count` of them. */
export function ticksBetween(low, high, count) {
  const step = roundAbove(Math.max(high - low, 1e-9) / count), ticks = [];
  for (let k = Math.ceil(low / step); k * step <= high; k++) ticks.push(+(k * step).toPrecision(8));
  return ticks;
}

const STEPS = [1 / 600, 1 / 120, 1 / 60, 1 / 30, 1 / 12, 1 / 6, 1 / 3, 1 / 2, 1, 2, 5, 10, 20, 30, 45];  // of a graticule [deg]

// Kinds of places that a map can have. `to` and `from` lead to the plane that is drawn; `around` is its extent in
// x, or 0; `scales` are the least and most pixels for a unit; `step` and `label` are for the lines of its grid.
export const EARTHLY = {
  to: mercator, from: degrees, around: 2 * Math.PI, scales: [110, 4e7], distance, beside,
  step: least => STEPS.find(one => one * RAD >= least) ?? 45,
  label: (value, axis, step) => axis ? angleText(value, "NS", step >= 1 / 60 ? 0 : 1) : angleText(turned(value), "EW", step >= 1 / 60 ? 0 : 1),
  text: place => placeText(place),
};
export const PLANAR = {  // metres
  to: place => place, from: place => place, around: 0, scales: [1e-9, 1e6], distance: ([a, b], [c, d]) => Math.hypot(c - a, d - b),
  beside: ([x, y], metres, direction) => [x + metres * Math.sin(direction), y + metres * Math.cos(direction)],
  step: least => roundAbove(least),
  label: (value, axis, step) => `${axis ? "north" : "east"} ${step >= 1000 ? `${(value / 1000).toLocaleString("en")} km` : `${value.toLocaleString("en")} m`}`,
  text: ([x, y]) => `${(x / 1000).toFixed(2)} km east, ${(y / 1000).toFixed(2)} km north`,
};

/** Corners of the ellipse with semi-axes a and b [m], a in the direction `azimuth` [deg]. */
export const ellipseAround = (plane, centre, [a, b, azimuth], corners = 36) => Array.from({ length: corners }, (_, k) => {
  const angle = 2 * Math.PI * k / corners, along = a * Math.cos(angle), across = b * Math.sin(angle);
  return plane.beside(centre, Math.hypot(along, across), azimuth * RAD + Math.atan2(across, along));
});

export const circle = (centre, metres, corners = 48) => ellipseAround(EARTHLY, centre, [metres, metres, 0], corners);

/** A latitude or longitude as degrees and minutes: 36°45.7′N. */
export function angleText(value, signs, digits = 1) {
  const minutes = +(Math.abs(value) * 60).toFixed(digits), whole = Math.floor(minutes / 60), rest = minutes - 60 * whole;
  const told = rest || digits ? `${rest.toFixed(digits).padStart(digits ? 3 + digits : 2, "0")}′` : "";
  return `${whole}°${told}${value < 0 ? signs[1] : signs[0]}`;
}

export const placeText = ([lon, lat]) => `${angleText(lat, "NS")} ${angleText(turned(lon), "EW")}`;
const turned = lon => ((lon + 180) % 360 + 360) % 360 - 180;

export const lengthText = metres => metres >= 2000 ? `${(metres / 1000).toLocaleString("en", { maximumFractionDigits: 1 })} km` : `${metres.toFixed(0)} m`;

/** Metres of "5 km", "3 nmi", "200 m" or "200"; NaN for anything else. */
export function metresOf(text) {
  const found = /^\s*([0-9]+(?:[.,][0-9]+)?)\s*(m|km|nmi|nm|ft|mi)?\s*$/i.exec(text);
  return found ? +found[1].replace(",", ".") * { m: 1, km: 1000, nmi: 1852, nm: 1852, ft: 0.3048, mi: 1609.344 }[(found[2] ?? "m").toLowerCase()] : NaN;
}

/** A place of "36.76, -92.40", "36°45.7'N 92°24'W" (latitude first); null for anything else. */
export function placeOf(text) {
  const one = /^\s*([+-]?[0-9]+(?:\.[0-9]+)?)\s*°?\s*(?:([0-9]+(?:\.[0-9]+)?)\s*['′]\s*)?([NSEW])?\s*/i;
  const first = one.exec(text);
  if (!first) return null;
  const rest = text.slice(first[0].length).replace(/^[,;]\s*/, ""), second = one.exec(rest);
  if (!second || second[0].length !== rest.length) return null;
  const value = found => (+found[1] + Math.sign(+found[1] || 1) * (+(found[2] ?? 0)) / 60) * (/[SW]/i.test(found[3] ?? "") ? -1 : 1);
  const lat = value(first), lon = value(second);
  return Math.abs(lat) <= MOST_LAT && Math.abs(lon) <= 360 && !/[EW]/i.test(first[3] ?? "") && !/[NS]/i.test(second[3] ?? "") ? [lon, lat] : null;
}

const RESERVED = new Set(["true", "false", "xor", "and", "or", "not", "until"]);

/** A name that formulas can have, from a title in any script, and different from the names `taken`. */
export function nameOf(title, taken) {
  const plain = title.normalize("NFKD").replace(/[\u0300-\u036f]/g, "").toLowerCase().replace(/[^a-z0-9]+/g, "_").replace(/^[_0-9]+|_+$/g, "");
  const letters = [..."abcdefghijklmnopqrstuvwxyz"];
  const wanted = plain && !RESERVED.has(plain) ? plain : letters.find(letter => !taken.has(letter)) ?? "region";
  let name = wanted;
  for (let k = 2; taken.has(name); k++) name = `${wanted}_${k}`;
  return name;
}

/** Whether two edges of an outline cross. */
export function crossesItself(corners) {
  const side = ([a, b], [c, d], [e, f]) => Math.sign((c - a) * (f - b) - (d - b) * (e - a)), n = corners.length;
  for (let i = 0; i < n; i++) for (let j = i + 2; j < n; j++) {
    if (i === 0 && j === n - 1) continue;
    const [a, b, c, d] = [corners[i], corners[i + 1], corners[j], corners[(j + 1) % n]];
    if (side(a, b, c) * side(a, b, d) < 0 && side(c, d, a) * side(c, d, b) < 0) return true;
  }
  return false;
}

/** The centre of mass of an outline. */
export function centre(corners) {
  let sum = 0, x = 0, y = 0;
  const [u, v] = corners[0];
  corners.forEach(([a, b], k) => {
    const [c, d] = corners[(k + 1) % corners.length], cross = (a - u) * (d - v) - (c - u) * (b - v);
    sum += cross; x += (a + c - 2 * u) * cross; y += (b + d - 2 * v) * cross;
  });
  return sum ? [u + x / (3 * sum), v + y / (3 * sum)] : corners[0];
}

// The branches of a plan on a map: what is flown after a position fix, each branch in its colour.

import { track } from "./flight.js";
import { html, percent, svg } from "./shapes.js";

const branchClass = name => `branch branch-${name[0]}${name.length > 1 ? " again" : ""}`;
const branchWords = ({ name, where, share }) => `Branch ${name}: the measured position is ${where} (${percent(share)} of the flights that take this fix)`;

/** The trunk if no point of the front has it, the lines of the branches with their names, a diamond at each fix. */
export function branchShapes(map, tree) {
  const lines = tree.branches.map(one => svg("path", { class: branchClass(one.name), d: map.line(one.line) }, svg("title", {}, branchWords(one))));
  const fixes = tree.branches.map(({ fix }) => map.at(fix)).map(([x, y]) => svg("path", { class: "branchfix", d: `M${x},${y - 6}l6,6l-6,6l-6,-6Z` }, svg("title", {}, "position fix")));
  return [...tree.trunk ? [track(map, tree.trunk)] : [], ...lines, ...fixes, ...firstBranches(tree).map(one => branchName(map, one))];
}

/** The name of a branch at the middle of its line. */
function branchName(map, { name, line }) {
  const [x, y] = map.at(line[Math.floor(line.length / 2)]);
  return svg("text", { class: `branchname branch-${name[0]}`, x, y: y - 5, "text-anchor": "middle" }, name);
}

const firstBranches = tree => tree.branches.filter(({ name }) => name.length === 1);

/** What the lines mean. */
export function branchNote(tree) {
  const again = tree.branches.some(({ name }) => name.length > 1) ? ", dotted after a second one" : "";
  return `Coloured lines: the branches, of which a position fix (diamond) selects one${again}: ${firstBranches(tree).map(({ name, share }) => `${name} ${percent(share)}`).join(", ")}. Each line says in words when it is flown.`;
}

/** The branches of the first fix as entries of a list of signs. */
export const branchKeys = tree => [html("li", {}, html("span", { class: "key branchfix" }), "position fix"), ...firstBranches(tree).map(({ name, share }) => html("li", {}, html("span", { class: `key branchway branch-${name}` }), `branch ${name}, ${percent(share)}`))];

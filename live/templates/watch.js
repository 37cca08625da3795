"use strict";
const EACH = 1000, OLD = 5000, SVG = "http://www.w3.org/2000/svg";
let heard = Date.now();

const at = (id) => document.getElementById(id);
function put(id, text) { const node = at(id); if (node.textContent !== text) node.textContent = text; }
function list(id, texts) {
  const node = at(id), now = [...node.children].map((one) => one.textContent);
  if (JSON.stringify(now) === JSON.stringify(texts)) return;
  node.replaceChildren(...texts.map((text) => { const item = document.createElement("li"); item.textContent = text; return item; }));
}
function shape(name, attributes, text) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== undefined) node.textContent = text;
  return node;
}
function bar(svg, of, end, unit) {
  const x = (value) => 8 + 584 * Math.min(Math.max(value / end, 0), 1), parts = [shape("rect", { class: "track", x: 8, y: 8, width: 584, height: 18 })];
  if (of.low !== null && of.high !== null) parts.push(shape("rect", { class: "band", x: x(of.low), y: 8, width: Math.max(x(of.high) - x(of.low), 1), height: 18 }));
  if (of.median !== null) parts.push(shape("path", { class: "median", d: `M${x(of.median)} 4V30` }));
  if (of.limit !== null) {
    parts.push(shape("path", { class: "limit", d: `M${x(of.limit)} 2V32` }));
    parts.push(shape("text", { x: x(of.limit), y: 44, "text-anchor": "middle" }, `${of.name} ${Number(of.limit.toPrecision(4))} ${unit}`));
  }
  svg.replaceChildren(...parts);
}
function curve(svg, points, wear) {
  const last = points.length ? points[points.length - 1] : null;
  if (!last || !wear.criterion) { svg.replaceChildren(); return; }
  const right = Math.max(...points.map((p) => p[0]), 0.1) * 1.15, top = Math.max(1.2 * wear.criterion, ...points.map((p) => p[3] || 0));
  const x = (value) => 48 + 540 * value / right, y = (value) => 160 - 150 * Math.min(value / top, 1);
  const known = points.filter((p) => p[2] !== null && p[3] !== null);
  const band = [...known.map((p) => `${x(p[0])},${y(p[3])}`), ...known.reverse().map((p) => `${x(p[0])},${y(p[2])}`)].join(" ");
  svg.replaceChildren(
    shape("path", { class: "axis", d: "M48 10V160H588" }),
    shape("polygon", { class: "band", points: band }),
    shape("polyline", { class: "median", points: points.map((p) => `${x(p[0])},${y(p[1])}`).join(" ") }),
    shape("path", { class: "limit", d: `M48 ${y(wear.criterion)}H588` }),
    shape("text", { x: 44, y: y(wear.criterion) + 4, "text-anchor": "end" }, String(Number(wear.criterion.toPrecision(3)))),
    shape("text", { x: 44, y: 163, "text-anchor": "end" }, "0"),
    shape("text", { x: 588, y: 180, "text-anchor": "end" }, `${right.toFixed(1)} min of contact`),
    shape("text", { x: 54, y: 20 }, `${wear.symbol}, ${wear.unit}`),
  );
}
function loads(facts) {
  const node = at("loads"), names = Object.keys(facts.loads);
  if (node.childElementCount !== 2 * names.length) {
    node.replaceChildren(...names.flatMap((name, k) => {
      const words = document.createElement("p"), svg = shape("svg", { viewBox: "0 0 600 46", role: "img", "aria-labelledby": `load-${k}` });
      words.id = `load-${k}`;
      return [words, svg];
    }));
  }
  names.forEach((name, k) => {
    const load = facts.loads[name], [words, svg] = [node.children[2 * k], node.children[2 * k + 1]];
    words.textContent = facts.load_words[name];
    const end = 1.3 * Math.max(load.high || 0, load.mean || 0) || 1; // of the cut: what is read holds the idle load too
    bar(svg, { low: load.low, high: load.high, median: load.mean, limit: load.expected, name: "expected" }, end, load.unit);
  });
}
function show(facts) {
  put("pair", [facts.tool, facts.work].filter(Boolean).join(" on ") || "fitmodels watch");
  document.title = `${facts.state}: ${facts.words.wear}`;
  put("state", facts.state);
  at("state").className = `badge ${facts.state}`;
  at("simulated").hidden = !facts.simulated;
  put("edge", `edge ${facts.edge.number}`);
  put("clock", facts.clock);
  list("alarms", facts.alarms.map((alarm) => `${alarm.clock} ${alarm.text}`));
  put("wear", facts.words.wear);
  const wear = facts.wear;
  bar(at("gauge"), { low: wear.low, high: wear.high, median: wear.median, limit: wear.criterion, name: "criterion" }, 1.25 * wear.criterion, wear.unit);
  curve(at("history"), facts.history, wear);
  put("decision", facts.decision ? facts.decision.text : "No decision yet.");
  at("decision").className = `value ${facts.decision && facts.decision.kind === "change" ? "change" : "go"}`;
  put("life", facts.words.life);
  put("risk", facts.words.risk);
  loads(facts);
  const rows = facts.rows.flatMap(([label, text]) => { const dt = document.createElement("dt"), dd = document.createElement("dd"); dt.textContent = label; dd.textContent = text; return [dt, dd]; });
  at("rows").replaceChildren(...rows);
  list("past", [...facts.advice.map((one) => `${one.clock} ${one.text}`), ...facts.notes]);
}
async function renew() {
  try {
    const answer = await fetch("facts.json", { cache: "no-store", signal: AbortSignal.timeout(3000) });
    if (answer.ok) { show(await answer.json()); heard = Date.now(); }
  } catch { /* said below */ }
  const old = Date.now() - heard > OLD;
  at("stale").hidden = !old;
  document.body.classList.toggle("old", old);
  if (old) put("stale", `No answer of the watch for ${Math.round((Date.now() - heard) / 1000)} s: what stands below is old.`);
  setTimeout(renew, EACH);
}
renew();

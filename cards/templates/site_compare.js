"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  if (!$("data")) return;
  const { pairs, verdicts, sets } = JSON.parse($("data").textContent);
  const LEVEL = 0.05;
  const SVG = "http://www.w3.org/2000/svg";

  const element = (name, attributes = {}, ...inner) => {
    const made = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...inner);
    return made;
  };
  const draw = (name, attributes, ...inner) => {
    const made = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
    made.append(...inner);
    return made;
  };

  // ln Gamma(x), x > 0: recurrence up to 8, then Stirling's series
  const lnGamma = (x) => {
    let shift = 0;
    for (; x < 8; x++) shift -= Math.log(x);
    const y = 1 / (x * x);
    const series = (1 / 12 - y * (1 / 360 - y * (1 / 1260 - y * (1 / 1680 - y / 1188)))) / x;
    return shift + (x - 0.5) * Math.log(x) - x + 0.5 * Math.log(2 * Math.PI) + series;
  };

  // regularised incomplete beta I_x(a, b), continued fraction 26.5.8 of Abramowitz & Stegun, after Lentz
  const beta = (x, a, b) => {
    if (x <= 0 || x >= 1) return x <= 0 ? 0 : 1;
    if (x > (a + 1) / (a + b + 2)) return 1 - beta(1 - x, b, a);
    const front = Math.exp(lnGamma(a + b) - lnGamma(a) - lnGamma(b) + a * Math.log(x) + b * Math.log1p(-x)) / a;
    const tiny = 1e-300;
    const safe = (v) => (Math.abs(v) < tiny ? tiny : v);
    let c = 1;
    let d = 1 / safe(1 - ((a + b) * x) / (a + 1));
    let h = d;
    for (let m = 1; m < 500; m++) {
      let e = (m * (b - m) * x) / ((a + 2 * m - 1) * (a + 2 * m));
      d = 1 / safe(1 + e * d);
      c = safe(1 + e / c);
      h *= d * c;
      e = (-(a + m) * (a + b + m) * x) / ((a + 2 * m) * (a + 2 * m + 1));
      d = 1 / safe(1 + e * d);
      c = safe(1 + e / c);
      h *= d * c;
      if (Math.abs(d * c - 1) < 1e-14) break;
    }
    return front * h;
  };

  // t = (b - b0) / sqrt(s^2 + s0^2) on Welch's degrees of freedom, and its p from both sides
  const differ = (one, other) => {
    if (one.se === null || other.se === null) return null;
    const [v, w] = [one.se ** 2, other.se ** 2];
    const df = (v + w) ** 2 / (v ** 2 / one.df + w ** 2 / other.df);
    const t = (one.value - other.value) / Math.sqrt(v + w);
    return { t, df, p: beta(df / (df + t * t), df / 2, 0.5) };
  };

  // Holm's adjusted p: the k-th smallest of m times m - k + 1, never below the one before
  const holm = (found) => {
    let least = 0;
    [...found]
      .sort((a, b) => a.p - b.p)
      .forEach((one, k) => {
        least = Math.max(least, Math.min(1, (found.length - k) * one.p));
        one.adjusted = least;
      });
  };

  const options = (select, items, chosen) => {
    select.replaceChildren(
      ...items.map(([value, words]) => {
        const option = element("option", { value }, words);
        option.selected = value === chosen;
        return option;
      }),
    );
    if (!items.some(([value]) => value === chosen)) select.selectedIndex = 0;
  };

  const words = [...new Set(sets.map((s) => s.words))];
  const chosenSet = () => sets.find((s) => s.words === $("law").value && s.factor === $("factor").value);
  const rowsOf = (set) =>
    set.rows.map(([at, value, se, df, low, high, text, lowText, highText, judged]) => ({
      pair: pairs[at], value, se, df, low, high, text,
      verdict: verdicts[judged],
      interval: lowText ? `${lowText} to ${highText}` : "no interval",
    })); // prettier-ignore

  // an axis that holds every value, and of the intervals what a few very wide ones do not squeeze the rest for
  const axisOf = (rows) => {
    const halves = rows.filter((r) => r.low !== null).map((r) => (r.high - r.low) / 2).sort((a, b) => a - b);
    const cap = 3 * (halves[Math.floor(halves.length / 2)] || 0);
    const lows = rows.map((r) => (r.low === null ? r.value : Math.max(r.low, r.value - cap)));
    const highs = rows.map((r) => (r.high === null ? r.value : Math.min(r.high, r.value + cap)));
    let [low, high] = [Math.min(...lows), Math.max(...highs)];
    if (low > 0 && low < 0.25 * (high - low)) low = 0;
    if (high < 0 && -high < 0.25 * (high - low)) high = 0;
    if (!(high > low)) [low, high] = [low - 0.5, high + 0.5];
    const raw = (high - low) / 5;
    const power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((k) => k * power).find((k) => k >= raw);
    const margin = 0.05 * (high - low);
    [low, high] = [low - margin, high + margin];
    const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    const ticks = [];
    for (let k = Math.ceil(low / step); k * step <= high; k++) ticks.push(k * step);
    const at = (x) => (100 * (x - low)) / (high - low);
    return { low, high, ticks, at, formatted: (x) => (Number(x.toFixed(decimals)) || 0).toFixed(decimals).replace("-", "−") };
  };

  const share = (x) => `${x.toFixed(3)}%`;
  const upright = (kind, x) => draw("line", { class: kind, x1: share(x), x2: share(x), y1: 0, y2: "100%" });
  const SHAPES = {
    plain: () => draw("circle", { class: "mark", r: 4.5 }),
    reference: () => draw("path", { class: "mark", d: "M-4.5-4.5h9v9h-9z" }),
    one: () => draw("path", { class: "mark", d: "M0-6 6 5H-6z" }),
    all: () => draw("path", { class: "mark", d: "M0-7 7 0 0 7-7 0z" }),
  };
  const mark = (kind, x) => draw("svg", { x: share(x), y: "50%", overflow: "visible" }, SHAPES[kind]());

  const track = (r, axis, reference) => {
    const svg = draw("svg", { class: "track", "aria-hidden": "true" });
    for (const x of axis.ticks) svg.append(upright(Math.abs(x) < 1e-12 ? "zero-line" : "grid-line", axis.at(x)));
    if (reference && reference.low !== null) {
      const [a, b] = [Math.max(axis.at(reference.low), 0), Math.min(axis.at(reference.high), 100)];
      svg.append(draw("rect", { class: "ref-band", x: share(a), width: share(b - a), y: 0, height: "100%" }));
    }
    if (reference) svg.append(upright("ref-line", axis.at(reference.value)));
    if (r.low !== null) {
      const [a, b] = [axis.at(r.low), axis.at(r.high)];
      svg.append(draw("line", { class: "bar", x1: share(Math.max(a, 0)), x2: share(Math.min(b, 100)), y1: "50%", y2: "50%" }));
      // an interval that goes on beyond the axis ends in an arrow
      const arrow = (x, d) => svg.append(draw("svg", { x, y: "50%", overflow: "visible" }, draw("path", { class: "bar", fill: "none", d })));
      if (a < 0) arrow("0%", "M7-5 2 0l5 5");
      if (b > 100) arrow("100%", "M-7-5-2 0l-5 5");
    }
    svg.append(mark(r.kind, axis.at(r.value)));
    return svg;
  };

  const VERDICTS = { plain: "not significant", one: "significant, unadjusted", all: "significant" };
  const verdict = (r, reference) => {
    if (r.kind === "reference") return "reference";
    if (!reference) return "";
    return r.found ? VERDICTS[r.kind] : "no interval";
  };

  const line = (r, axis, reference) => {
    const name = element("span", { class: "name" }, element("a", { href: `cards/${r.pair.slug}/index.html` }, r.pair.title));
    if (r.pair.source) name.append(" ", element("span", { class: "fine" }, r.pair.source));
    const [icon, words, css] = r.verdict;
    const shown = css === "usable" ? { class: "hidden" } : {};
    const badge = element("span", { class: `badge ${css}` }, element("span", { class: "icon", "aria-hidden": "true" }, icon), " ");
    badge.append(element("span", shown, words));
    if (r.pair.simulated) name.append(" ", element("span", { class: "fine" }, "simulated"));
    name.append(" ", badge);
    const value = element("span", { class: "number" }, element("b", {}, r.text), ` (${r.interval})`);
    const button = element("button", { type: "button", "aria-pressed": String(r.kind === "reference") }, "reference");
    button.setAttribute("aria-label", `reference: ${named(r.pair)}`);
    button.addEventListener("click", () => {
      $("reference").value = r.kind === "reference" ? "" : r.pair.slug;
      show();
      ($("forest").querySelector('[aria-pressed="true"]') || $("reference")).focus();
    });
    const quiet = r.kind === "plain" && r.found ? { class: "hidden" } : {}; // what is marked is to be seen at a glance
    const last = element("span", { class: "verdict" }, element("span", quiet, verdict(r, reference)), button);
    const item = element("li", { class: r.kind, "data-slug": r.pair.slug });
    if (r.found) {
      item.dataset.p = r.found.p;
      item.dataset.adjusted = r.found.adjusted;
      last.firstChild.title = `t ${r.found.t.toFixed(2)} on ${r.found.df.toFixed(1)} degrees of freedom`;
    }
    item.append(name, element("span", { class: "lane" }, track(r, axis, reference)), value, last);
    return item;
  };

  const named = (pair) => (pair.source ? `${pair.title} (${pair.source})` : pair.title);
  const few = (x) => (x < 10 ? String(Math.round(10 * x) / 10) : String(Math.round(x)));
  const summarise = (reference, found, shown) => {
    if (!reference) return [`${shown} pair${shown === 1 ? "" : "s"}. Choose a reference to see which exponents differ from it.`];
    const one = found.filter((r) => r.found.p < LEVEL).length;
    const all = found.filter((r) => r.found.adjusted < LEVEL).length;
    return [
      element("strong", {}, `${all} of ${found.length} differ from ${named(reference.pair)}`),
      `, adjusted for ${found.length} comparisons (Holm). Unadjusted ${one} differ, of which about ${few(LEVEL * found.length)} are `,
      "expected by chance if all were equal.",
    ];
  };

  const byName = new Intl.Collator("en", { numeric: true });
  const ORDERS = {
    value: (a, b) => b.value - a.value,
    name: (a, b) => byName.compare(named(a.pair), named(b.pair)),
    difference: (a, b) => (b.found ? b.found.t : -Infinity) - (a.found ? a.found.t : -Infinity),
  };

  const show = () => {
    const rows = rowsOf(chosenSet());
    const reference = rows.find((r) => r.pair.slug === $("reference").value);
    const fits = (r) => ["tool", "work", "group"].every((name) => !$(name).value || r.pair[name] === $(name).value);
    const others = rows.filter((r) => r !== reference && fits(r));
    const axis = axisOf(reference ? [reference, ...others] : others.length ? others : rows);
    for (const r of others) {
      r.found = reference ? differ(r, reference) : null;
      r.kind = "plain";
    }
    const found = others.filter((r) => r.found);
    holm(found.map((r) => r.found));
    for (const r of found) r.kind = r.found.adjusted < LEVEL ? "all" : r.found.p < LEVEL ? "one" : "plain";
    const compare = ORDERS[$("order").value];
    others.sort((a, b) => compare(a, b) || ORDERS.name(a, b));
    const shown = $("shown").value && reference ? others.filter((r) => r.kind !== "plain") : others;
    if (reference) {
      reference.kind = "reference";
      shown.unshift(reference);
    }
    $("forest").replaceChildren(...shown.map((r) => line(r, axis, reference)));
    $("comparison").replaceChildren(...(others.length ? summarise(reference, found, others.length) : ["No pair matches the filters."]));
    $("axis").replaceChildren(
      ...axis.ticks.map((x) => draw("text", { x: share(axis.at(x)), y: "70%", "text-anchor": "middle" }, axis.formatted(x))),
    );
    remember();
  };

  const pickFactor = (wanted) => {
    options($("factor"), sets.filter((s) => s.words === $("law").value).map((s) => [s.factor, s.factor]), wanted);
    pickReference($("reference").value);
  };
  const pickReference = (wanted) => {
    const choices = rowsOf(chosenSet()).sort(ORDERS.name).map((r) => [r.pair.slug, named(r.pair)]);
    options($("reference"), [["", "none"], ...choices], wanted);
  };

  // what is chosen stands in the address, so that it can be sent
  const KEPT = ["law", "factor", "reference", "order", "tool", "work", "group", "shown"];
  const remember = () => {
    const kept = new URLSearchParams(KEPT.filter((id) => $(id).value).map((id) => [id, $(id).value]));
    try {
      history.replaceState(null, "", `#${kept}`);
    } catch {} // some browsers forbid it to files
  };
  const recall = () => {
    const kept = new URLSearchParams(location.hash.slice(1));
    options($("law"), words.map((w) => [w, w]), kept.get("law"));
    pickFactor(kept.get("factor"));
    pickReference(kept.get("reference"));
    for (const id of ["order", "tool", "work", "group", "shown"])
      if ([...$(id).options].some((o) => o.value === kept.get(id))) $(id).value = kept.get(id);
  };

  for (const kind of ["plain", "one", "all", "reference"]) $(`legend-${kind}`).append(mark(kind, 50));
  recall();
  for (const id of ["tool", "work", "group"]) $(id).parentElement.hidden = $(id).options.length < 2;
  $("more").open = ["tool", "work", "group", "shown"].some((id) => $(id).value);
  for (const id of KEPT)
    $(id).addEventListener("change", () => {
      if (id === "law") pickFactor($("factor").value);
      if (id === "factor") pickReference($("reference").value);
      show();
    });
  $("filters").addEventListener("submit", (event) => event.preventDefault());
  $("live").hidden = false;
  $("tables").hidden = true;
  show();
})();

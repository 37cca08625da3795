"use strict";
(() => {
  const $ = (id) => document.getElementById(id);

  for (const button of document.querySelectorAll("button[data-copy]")) {
    button.hidden = false;
    button.addEventListener("click", async () => {
      const code = $(button.dataset.copy);
      let said = "Copied.";
      try {
        await navigator.clipboard.writeText(code.textContent);
      } catch {
        getSelection().selectAllChildren(code);
        said = "Selected: copy it with the keyboard.";
      }
      $("copy-status").textContent = said;
      button.textContent = said === "Copied." ? "Copied" : "Selected";
      setTimeout(() => (button.textContent = "Copy"), 2000);
    });
  }

  addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((d) => (d.open = true)));

  const source = $("profiler-data");
  if (!source) return;
  const P = JSON.parse(source.textContent);
  const STEPS = 240; // of a slider, its reach beyond the tests included
  const REACH = 1.2;
  const laws = Object.fromEntries(P.laws.map((law) => [law.response, law]));
  const at = {};

  // as Python's %.{digits}g
  const plain = (x, digits) => {
    if (x === 0) return "0";
    const [mantissa, power] = x.toExponential(digits - 1).split("e").map(Number);
    if (power >= -4 && power < digits) return String(Number(x.toPrecision(digits)));
    return `${mantissa}e${power < 0 ? "-" : "+"}${String(Math.abs(power)).padStart(2, "0")}`;
  };

  const decimals = (u) => {
    if (!(u > 0 && u < Infinity)) return 6;
    return 1 - Number(u.toExponential(1).split("e")[1]);
  };

  // value to the digits that its uncertainty deserves
  const rounded = (x, u) => {
    if (u <= Math.abs(x) * 1e-5) return plain(x, 7);
    const places = decimals(u);
    if (places > 6 || Math.abs(x) >= 1e7) {
      const power = Math.floor(Math.log10(Math.max(Math.abs(x), u)));
      return `${(x / 10 ** power).toFixed(Math.max(places + power, 0))}e${power}`;
    }
    if (places < 0) return String(Math.round(x / 10 ** -places) * 10 ** -places);
    return (Number(x.toFixed(places)) || 0).toFixed(places);
  };

  const form = (z, M) => z.reduce((sum, a, i) => sum + a * z.reduce((s, b, j) => s + M[i][j] * b, 0), 0);

  // 1, then the product of powers of the centred factors of each term
  const columns = (law, at) => {
    const u = law.factors.map((name, i) => (law.logs[i] ? Math.log(at[name] / law.centres[i]) : at[name] - law.centres[i]));
    return [1, ...law.terms.map((powers) => powers.reduce((x, d, i) => x * u[i] ** d, 1))];
  };

  // value, low, high: R, and R exp(+- t sqrt(g'Cg/R^2 + s^2)), or R +- t sqrt(g'Cg + s^2)
  const predict = (law, point) => {
    const z = columns(law, point);
    const last = law.added ? z.pop() : 0;
    const eta = z.reduce((sum, x, i) => sum + x * law.theta[i], 0);
    const size = law.logarithmic ? Math.exp(eta) : 1;
    const R = (law.logarithmic ? size : eta) + (last && last * law.theta[z.length]);
    const no = [R, null, null];
    if (!law.covariance.length || law.scatter === null || law.t === null || (law.multiplies && R <= 0)) return no;
    const g = z.map((x) => size * x);
    if (law.added) g.push(last);
    const v = Math.max(form(g, law.covariance), 0) / (law.multiplies ? R * R : 1);
    const half = law.t * Math.sqrt(v + law.scatter ** 2);
    return law.multiplies ? [R, R * Math.exp(-half), R * Math.exp(half)] : [R, R - half, R + half];
  };

  const inside = (law, point) => {
    const x = law.factors.map((name) => point[name]);
    const r = law.region;
    if (!r) return x.every((value, i) => law.low[i] <= value && value <= law.high[i]);
    if (x.some((value, i) => r.logs[i] && value <= 0)) return false;
    const u = x.map((value, i) => ((r.logs[i] ? Math.log(value) : value) - r.centre[i]) / r.half_range[i]);
    if (u.some((c) => Math.abs(c) > 1 + r.rounding)) return false;
    if (u.reduce((sum, c) => sum + c * c, 0) > r.radius ** 2 * (1 + r.slack)) return false;
    return r.spaces.every((s) => {
      const z = s.columns.map((column) => (column ? u[column - 1] : 1));
      return form(z, s.matrix) <= s.largest * (1 + r.slack);
    });
  };

  // a slider: its steps in the law's own scale, the ends of the tests on a step
  const sliders = [...P.factors, ...P.wears].map((f, i) => {
    const [low, high] = [f.low.value, f.high.value];
    const logs = low > 0 && P.laws.some((law) => law.logs[law.factors.indexOf(f.symbol)]);
    const [a, b] = logs ? [Math.log(low), Math.log(high)] : [low, high];
    const reach = logs ? Math.log(REACH) : (REACH - 1) * (high - low || Math.abs(high) || 1);
    const step = (b - a + 2 * reach) / STEPS;
    const [first, last] = [Math.round(reach / step), STEPS - Math.round(reach / step)];
    const value = (k) => {
      if (k === first) return low;
      if (k === last) return high;
      const exact = a - reach + k * step;
      const x = Number((logs ? Math.exp(exact) : exact).toPrecision(3));
      return k > first && k < last ? Math.min(Math.max(x, low), high) : x;
    };
    const where = (x) => Math.round(((logs ? Math.log(x) : x) - a + reach) / step);
    return { f, value, where, input: $(`slider-${i}`), output: $(`value-${i}`) };
  });

  const withUnit = (text, unit) => (unit ? `${text}\u00a0${unit}` : text);

  const show = () => {
    const point = { ...at };
    const held = Boolean($("wear-held")?.checked);
    for (const law of P.laws) if (law.wear && !held) point[law.wear] = predict(laws[law.wear], at)[0];
    const outside = [];
    const heard = [];
    P.laws.forEach((law, i) => {
      const [value, low, high] = predict(law, point);
      const width = low === null ? 0 : low > 0 ? Math.min((high - low) / 2, low) : (high - low) / 2;
      const text = low === null ? [plain(value, 4)] : [value, low, high].map((x) => rounded(x, width));
      const known = inside(law, point) && (held || !law.wear || inside(laws[law.wear], at));
      if (!known) outside.push(law);
      const row = $(`answer-${i}`);
      row.classList.toggle("out", !known);
      row.querySelector(".value").textContent = text[0];
      row.querySelector(".band").textContent = low === null ? "no band" : `${text[1]} to ${text[2]}`;
      row.querySelector(".tested").textContent = known ? "yes" : "no";
      heard.push(`${law.response} ${text[0]} ${law.unit}${low === null ? "" : `, ${text[1]} to ${text[2]}`}`);
    });
    if (P.removal) $("answer-removal").querySelector(".value").textContent = Number((1000 * at.V * at.f * at.d).toPrecision(4));
    say(reason(outside, point), heard);
  };

  const reason = (outside, point) => {
    if (!outside.length) return "Inside the tested region.";
    const why = new Set();
    for (const law of outside)
      law.factors.forEach((name, i) => {
        const x = point[name];
        const end = x > law.high[i] * (1 + 1e-3) ? "high" : x < law.low[i] * (1 - 1e-3) ? "low" : "";
        if (!end) return;
        const unit = (P.factors.find((f) => f.symbol === name) || laws[name] || {}).unit || "";
        const side = end === "high" ? ["above", "highest"] : ["below", "lowest"];
        const limit = withUnit(plain(law[end][i], 4), unit);
        why.add(`${name} ${withUnit(plain(x, 3), unit)} is ${side[0]} ${limit}, the ${side[1]} tested`);
      });
    const cause = [...why].join(", and ") || "this combination is farther from the centre of the tests than any test";
    return `Outside the tested region of ${outside.map((law) => law.response).join(", ")}: ${cause}. Do not rely on the grey numbers.`;
  };

  let timer = 0;
  const say = (sentence, heard) => {
    const where = $("profiler-where");
    where.textContent = sentence;
    where.classList.toggle("alarm", !sentence.startsWith("Inside"));
    clearTimeout(timer); // the reader's voice waits for the slider to rest
    timer = setTimeout(() => ($("profiler-status").textContent = `${sentence} ${heard.join("; ")}.`), 500);
  };

  const set = (s, value) => {
    at[s.f.symbol] = value;
    const text = withUnit(plain(value, 4), s.f.unit);
    s.output.textContent = text;
    s.input.setAttribute("aria-valuetext", text);
  };

  const choose = () => {
    for (const each of document.querySelectorAll("[data-wear]")) each.hidden = !$("wear-held").checked;
    show();
  };

  const reset = () => {
    for (const s of sliders) {
      s.input.value = s.where(P.start[s.f.symbol]);
      set(s, P.start[s.f.symbol]);
    }
    show();
  };

  for (const s of sliders)
    s.input.addEventListener("input", () => {
      set(s, s.value(Number(s.input.value)));
      show();
    });
  for (const id of ["wear-own", "wear-held"]) $(id)?.addEventListener("change", choose);
  $("profiler-reset").addEventListener("click", reset);
  reset();
  $("profiler-live").hidden = false;
  $("profiler-table").hidden = true;
})();

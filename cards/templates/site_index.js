"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const body = $("cards").tBodies[0];
  const plain = (text) => text.normalize("NFKD").replace(/\p{M}/gu, "").toLowerCase();
  const rows = [...body.rows].map((row) => ({
    row,
    text: plain([...row.cells].filter((cell) => !cell.dataset.value).map((cell) => cell.textContent).join(" ")),
    laws: JSON.parse(row.dataset.laws),
    keys: [...row.cells].map((cell) => (cell.dataset.value ? Number(cell.dataset.value) : plain(cell.textContent.trim()))),
  }));
  const filters = ["tool", "work", "group", "law", "verdict", "kind"].map((name) => ({ name, input: $(name) }));

  const show = () => {
    const words = plain($("search").value).split(/\s+/).filter(Boolean);
    let shown = 0;
    for (const r of rows) {
      const fits = filters.every(({ name, input }) => {
        if (!input.value) return true;
        return name === "law" ? r.laws.includes(input.value) : r.row.dataset[name] === input.value;
      });
      r.row.hidden = !(fits && words.every((word) => r.text.includes(word)));
      shown += r.row.hidden ? 0 : 1;
    }
    const of = shown === rows.length ? `${shown} card${shown === 1 ? "" : "s"}` : `${shown} of ${rows.length} cards`;
    $("count").textContent = shown ? of : `None of ${rows.length} cards matches the filters.`;
  };

  const order = new Intl.Collator("en", { numeric: true });
  const sort = (column, heading) => {
    const down = heading.getAttribute("aria-sort") === "ascending";
    for (const cell of heading.parentElement.cells) cell.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", down ? "descending" : "ascending");
    const sign = down ? -1 : 1;
    const compare = (a, b) => (typeof a === "number" ? a - b : order.compare(a, b));
    rows.sort((a, b) => sign * compare(a.keys[column], b.keys[column]) || compare(a.keys[0], b.keys[0]));
    body.append(...rows.map((r) => r.row));
  };

  [...$("cards").tHead.rows[0].cells].forEach((heading, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = heading.textContent;
    heading.replaceChildren(button);
    button.addEventListener("click", () => sort(column, heading));
  });
  $("search").addEventListener("input", show);
  for (const { input } of filters) {
    input.parentElement.hidden = input.options.length < 2;
    input.addEventListener("change", show);
  }
  $("filters").addEventListener("submit", (event) => event.preventDefault());
  $("filters").hidden = false;
  show();
})();

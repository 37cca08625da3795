// Drop a file onto the page, open the form that a message names, and say on failure that the program has ended.
"use strict";
(() => {
  const said = document.getElementById("said");
  const form = document.querySelector("[data-drop]");
  const input = form && form.querySelector("input[type=file]");
  for (const name of ["dragover", "drop"]) {
    document.addEventListener(name, (event) => event.preventDefault());
  }
  if (form) {
    document.addEventListener("dragover", () => form.classList.add("over"));
    document.addEventListener("dragleave", (event) => {
      if (!event.relatedTarget) form.classList.remove("over");
    });
    document.addEventListener("drop", (event) => {
      form.classList.remove("over");
      if (event.dataTransfer && event.dataTransfer.files.length) {
        input.files = event.dataTransfer.files;
        form.requestSubmit();
      }
    });
    input.addEventListener("change", () => input.files.length && form.requestSubmit());
    form.querySelector("button").hidden = true; // a chosen file is added at once
  }
  if (!form) {
    document.addEventListener("drop", () => {
      said.textContent = "A file is added on the page of the project: follow the link 'fitmodels' at the top.";
    });
  }
  // The field of a link gets the value that the message names, a form the values of its fields by name.
  const fill = (target, given) => {
    if (given && target.matches("input")) target.value = given;
    for (const part of given && target.matches("details") ? given.split(" ") : []) {
      const [name, value] = part.split("=");
      const field = target.querySelector(`input[name="${CSS.escape(name)}"]`);
      if (field && value) field.value = value;
    }
  };
  // An answer is of the values that its form had; fields of an export are those of its kind.
  const former = (field) => {
    const form = field.matches("details") ? field.querySelector("form") : field.closest("form");
    const answer = form && /^#answer-/.test(form.getAttribute("hx-target") || "") && document.querySelector(form.getAttribute("hx-target"));
    if (answer && answer.querySelector(".result")) answer.classList.add("former");
  };
  const ofKind = () => {
    const kind = document.getElementById("export-to");
    for (const field of kind ? kind.form.querySelectorAll("[data-kinds]") : []) {
      field.hidden = field.disabled = !field.dataset.kinds.split(" ").includes(kind.value);
    }
  };
  for (const name of ["input", "change"]) {
    document.addEventListener(name, (event) => {
      if (event.target.id === "export-to") ofKind();
      former(event.target);
    });
  }
  document.addEventListener("click", (event) => {
    const link = event.target.closest("[data-open]");
    const target = link && document.getElementById(link.dataset.open);
    if (!target) return;
    for (let outer = target.closest("details"); outer; outer = outer.parentElement.closest("details")) {
      outer.open = true;
    }
    fill(target, link.dataset.fill || "");
    if (link.dataset.fill) former(target);
    if (!target.matches("details, section, h2, h3")) setTimeout(() => target.focus());
  });
  // An answer is brought into view and gets the focus, unless another form is being filled in.
  const still = window.matchMedia("(prefers-reduced-motion: reduce)");
  const brought = (answer) => {
    const active = document.activeElement;
    const typing = active && active.matches("input, select, textarea");
    if (typing && active.closest("details, div.doubt") !== answer.closest("details, div.doubt")) return;
    const box = answer.getBoundingClientRect();
    if (box.top < 0 || box.bottom > window.innerHeight) {
      answer.scrollIntoView({ block: box.height > window.innerHeight / 2 ? "start" : "nearest", behavior: still.matches ? "auto" : "smooth" });
    }
    if (!answer.querySelector(".waiting")) answer.focus({ preventScroll: true });
  };
  document.body.addEventListener("htmx:afterSwap", (event) => {
    ofKind();
    const answer = event.target.closest && event.target.closest(".answer");
    if (answer) answer.classList.remove("former");
    if (answer && answer.id === "answer-card" && answer.querySelector(".result")) {
      for (const frame of document.querySelectorAll("iframe.card")) frame.src = `${frame.src.split("?")[0]}?${Date.now()}`;
    }
    if (answer && answer.firstElementChild && answer.dataset.state !== state(answer)) {
      answer.dataset.state = state(answer);
      brought(answer);
    }
  });
  const state = (answer) => (answer.querySelector(".waiting") ? "waiting" : answer.textContent.slice(0, 400));
  // A page that is loaded again after a correction stays where it was; one with the name of a form opens it.
  const place = `at ${location.pathname}`;
  document.body.addEventListener("htmx:beforeOnLoad", (event) => {
    if (event.detail.xhr.getResponseHeader("HX-Redirect") === location.pathname) sessionStorage.setItem(place, window.scrollY);
  });
  let kept = sessionStorage.getItem(place);
  sessionStorage.removeItem(place);
  for (const name of ["wheel", "pointerdown", "keydown"]) {
    document.addEventListener(name, () => (kept = null), { once: true, passive: true });
  }
  document.body.addEventListener("htmx:afterSettle", (event) => {
    if (kept !== null) window.scrollTo(0, Number(kept));
    const named = event.target.id === "machine" && location.hash && document.getElementById(location.hash.slice(1));
    if (named && named.matches("details") && named.closest("#machine")) {
      named.open = true;
      named.scrollIntoView();
    }
  });
  document.addEventListener("input", (event) => {
    const shown = event.target.dataset && document.getElementById(event.target.dataset.shown);
    if (shown) shown.textContent = event.target.value;
  });
  document.body.addEventListener("htmx:sendError", () => {
    said.textContent = "The program has ended or does not answer: run 'fitmodels app' again. Files and results are kept.";
    said.classList.add("alert");
  });
  document.body.addEventListener("htmx:beforeRequest", () => {
    said.textContent = "";
    said.classList.remove("alert");
  });
})();

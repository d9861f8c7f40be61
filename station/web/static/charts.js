// The charts: a drag across the units chooses some of them for the list; everything also works by the form alone.
"use strict";
(() => {
  const byId = (id) => document.getElementById(id), figure = byId("units");
  byId("print").addEventListener("click", () => window.print());
  if (!figure) return;
  const count = Number(figure.dataset.count), first = byId("first"), last = byId("last");
  // The chart is there twice, for a wide window and for a narrow one; each has its plot and its zone of chosen units.
  const plots = [...figure.querySelectorAll("svg")].map((svg) => ({ plot: svg.querySelector(".brush"), zone: svg.querySelector(".picked") }));
  let start = 0;

  /** The number of the unit under the pointer. */
  function unitAt(event) {
    const shown = plots.find(({ plot }) => plot.getClientRects().length), box = shown.plot.getBoundingClientRect(), share = (event.clientX - box.left) / box.width;
    return Math.min(Math.max(Math.round(0.5 + share * count), 1), count);
  }

  /** Shows the units from a to b; those that the answer left out are fetched by the form. */
  function choose(a, b) {
    const [low, high] = a < b ? [a, b] : [b, a];
    first.value = low; last.value = high;
    for (const { plot, zone } of plots) {
      const width = Number(plot.getAttribute("width")), left = Number(plot.getAttribute("x"));
      zone.setAttribute("x", left + width * (low - 1) / count);
      zone.setAttribute("width", width * (high - low + 1) / count);
    }
    let shown = 0;
    for (const row of document.querySelectorAll("[data-number]")) {
      const inside = row.dataset.number >= low && row.dataset.number <= high;
      if (row.tagName === "TR") { row.hidden = !inside; shown += inside; } else row.disabled = !inside;
    }
    byId("chosen").textContent = shown;
    return shown === high - low + 1;
  }

  figure.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !event.target.closest("svg")) return;
    start = unitAt(event); figure.setPointerCapture(event.pointerId); event.preventDefault();
  });
  figure.addEventListener("pointermove", (event) => { if (start) choose(start, unitAt(event)); });
  figure.addEventListener("pointerup", (event) => {
    if (!start) return;
    const whole = choose(start, unitAt(event));
    start = 0;
    if (!whole) byId("ask").requestSubmit();
  });
  figure.addEventListener("pointercancel", () => { start = 0; });
  for (const field of [first, last]) field.addEventListener("change", () => {
    if (first.value && last.value && !choose(Number(first.value), Number(last.value))) byId("ask").requestSubmit();
  });
})();

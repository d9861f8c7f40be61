// Pieces that the operator's screen is made of: elements, figures, times, icons, bars, sounds.
"use strict";
const Parts = (() => {
  const begin = JSON.parse(document.getElementById("begin").textContent);
  const texts = begin.texts;

  /** An element: h("p", { class: "hint", hidden: true }, "text", child, ...). Text is never taken for markup. */
  function h(tag, options, ...children) {
    const node = document.createElement(tag);
    for (const [key, value] of Object.entries(options || {})) {
      if (value === undefined || value === null || value === false) continue;
      if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
      else if (key.startsWith("--")) node.style.setProperty(key, value);
      else node.setAttribute(key, value === true ? "" : value);
    }
    node.append(...children.flat(Infinity).filter((c) => c !== null && c !== undefined && c !== false && c !== ""));
    return node;
  }
  /** SVG of ours: icons, and the pictures that the server draws. */
  function svg(markup) {
    const holder = document.createElement("template");
    holder.innerHTML = markup;
    return holder.content.firstElementChild;
  }
  const PATHS = {
    check: '<path class="glyph" d="M4 13l5 5L20 6"/>', cross: '<path class="glyph" d="M5 5l14 14M19 5L5 19"/>',
    warn: '<path class="glyph" d="M12 3L2 21h20zM12 10v5M12 18v.5"/>', square: '<path class="solid" d="M5 5h14v14H5z"/>',
    play: '<path class="solid" d="M6 3l15 9-15 9z"/>', hand: '<path class="glyph" d="M8 13V6a1.5 1.5 0 013 0v5-7a1.5 1.5 0 013 0v7-5a1.5 1.5 0 013 0v8c0 5-2 8-6 8-3 0-5-2-7-6l-2-3a1.500 1.500 0 012.500-1.500z" stroke-width="2"/>',
    identify: '<path class="solid" d="M3 5h2v14H3zM7 5h1v14H7zM10 5h3v14h-3zM15 5h1v14h-1zM18 5h3v14h-3z"/>',
    write: '<path class="glyph" d="M12 3v12M7 11l5 5 5-5M4 21h16"/>', verify: '<path class="glyph" d="M3 3h18v18H3zM7 12l4 4 7-8"/>',
    heat: '<path class="glyph" d="M10 14V5a2 2 0 014 0v9a4 4 0 11-4 0zM12 9v8"/>', motor: '<path class="glyph" d="M4 8h12v9H4zM16 11h4v3h-4M7 8V5h6v3"/>',
    todo: '<circle class="glyph" cx="12" cy="12" r="8"/>', going: '<circle class="glyph" cx="12" cy="12" r="8"/><circle class="solid" cx="12" cy="12" r="4"/>',
    to: '<path class="glyph" d="M3 12h17M14 5l7 7-7 7"/>', again: '<path class="glyph" d="M19 12a7 7 0 11-2-5M18 3v5h-5"/>', pause: '<path class="glyph" d="M8 5v14M16 5v14"/>',
  };
  const icon = (name) => svg(`<svg class="icon" viewBox="0 0 24 24" aria-hidden="true">${PATHS[name]}</svg>`);
  const SYMBOLS = { PASS: "check", FAIL: "cross", ERROR: "warn", ABORTED: "square", INTERRUPTED: "pause" };

  /** Pictures side by side, cut to what is drawn in them: the same scale for all. */
  function fit(drawn) {
    const boxes = drawn.map((picture) => picture.getBBox());
    const wide = Math.max(...boxes.map((b) => b.width)) + 8, top = Math.min(...boxes.map((b) => b.y)) - 4, end = Math.max(...boxes.map((b) => b.y + b.height)) + 4;
    if (end - top > 20) drawn.forEach((picture, i) => picture.setAttribute("viewBox", `${boxes[i].x + boxes[i].width / 2 - wide / 2} ${top} ${wide} ${end - top}`));
  }

  /** A text with its {places} filled in. */
  const fill = (key, values = {}) => texts[key].replace(/\{(\w+)\}/g, (_, name) => values[name]);
  const locale = new Intl.Locale(begin.language);
  const list = (names) => new Intl.ListFormat(locale, { type: "conjunction", style: "narrow" }).format(names);
  const figure = (v, digits) => (v < 0 ? "−" : "+") + Math.abs(v).toFixed(digits);
  const clock = (s) => `${Math.floor(Math.max(0, s) / 60)}:${String(Math.floor(Math.max(0, s) % 60)).padStart(2, "0")}`;
  const seconds = (s) => (s < 9.95 ? `${s.toFixed(1)} s` : s < 99.5 ? `${Math.round(s)} s` : clock(s));
  const moment = (s) => new Intl.DateTimeFormat(locale, { hour: "2-digit", minute: "2-digit", hour12: false }).format(new Date(s * 1000));
  const day = (s) => new Intl.DateTimeFormat(locale, { weekday: "short", day: "numeric", month: "short" }).format(new Date(s * 1000));

  /** Sets a text only where it is another one: what does not change is not painted again. */
  const say = (node, words) => { if (node && node.textContent !== words) node.textContent = words; };

  /** Three bars with the mark of what is expected. full: the end of the scale. */
  function gauges(unit) {
    const rows = ["x", "y", "z"].map((axis) => {
      const value = h("b"), bar = h("i"), mark = h("u", { hidden: true });
      return { value, bar, mark, node: h("div", {}, h("div", { class: "row" }, axis, value), h("div", { class: "gauge", "aria-hidden": "true" }, bar, mark)) };
    });
    const key = h("p", { class: "key" }, texts.live, h("span", {}, h("i", { "aria-hidden": "true" }), texts.expected));
    const node = h("div", { class: "live" }, key, rows.map((r) => r.node));
    const show = (vector, expected, full) => rows.forEach((row, i) => {
      const v = vector && vector.length ? vector[i] : null;
      const place = (x) => 50 + 50 * Math.max(-1, Math.min(1, x / full));
      say(row.value, v === null ? "–" : `${figure(v, full < 20 ? 3 : 2)} ${unit}`);
      row.bar.style.left = `${v === null ? 50 : Math.min(50, place(v))}%`;
      row.bar.style.width = `${v === null ? 0 : Math.abs(place(v) - 50)}%`;
      row.mark.hidden = !expected;
      if (expected) row.mark.style.left = `${place(expected[i])}%`;
    });
    return { node, show };
  }

  /** A value between its limits. All numbers are places from 0 to 1 that the server has computed. */
  function limitBar(bar, label) {
    const x = (v) => (20 + 360 * v).toFixed(1), n = (v) => Number(v);
    const ticks = bar.ticks.map(([at]) => `<line class="${at === bar.target && bar.target !== bar.low ? "target" : "end"}" x1="${x(n(at))}" x2="${x(n(at))}" y1="34" y2="64"/>`).join("");
    const drawn = svg(`<svg class="limit" viewBox="0 0 400 92" role="img"><rect class="zone" x="${x(n(bar.low))}" width="${(360 * (n(bar.high) - n(bar.low))).toFixed(1)}" y="40" height="18"/><line class="axis" x1="10" x2="390" y1="49" y2="49"/>${ticks}<path class="mark${bar.inside ? "" : " off"}" d="M${x(n(bar.value))} 46l-9-20h18z"/></svg>`);
    bar.ticks.forEach(([at, words]) => {
      const text = document.createElementNS("http://www.w3.org/2000/svg", "text");
      text.setAttribute("x", x(n(at))); text.setAttribute("y", "86"); text.textContent = words;
      drawn.append(text);
    });
    drawn.setAttribute("aria-label", label);
    return drawn;
  }

  // Sound: short tones, different for each thing to hear, silent until somebody has touched the page.
  let audio = null;
  const TONES = { act: [[660, 0], [880, 0.18], [660, 0.36]], pass: [[660, 0], [990, 0.16]], fail: [[330, 0], [220, 0.22]], refused: [[240, 0]] };
  const soundOn = () => localStorage.getItem("sound") !== "off";
  function sound(name) {
    if (!soundOn() || !navigator.userActivation || !navigator.userActivation.hasBeenActive) return;
    audio = audio || new AudioContext();
    for (const [pitch, after] of TONES[name]) {
      const tone = audio.createOscillator(), level = audio.createGain(), at = audio.currentTime + after;
      tone.frequency.value = pitch;
      level.gain.setValueAtTime(0.25, at);
      level.gain.exponentialRampToValueAtTime(0.001, at + 0.17);
      tone.connect(level).connect(audio.destination);
      tone.start(at); tone.stop(at + 0.18);
    }
  }
  return { begin, texts, h, svg, icon, SYMBOLS, fill, list, clock, seconds, moment, day, say, gauges, limitBar, fit, sound, soundOn };
})();

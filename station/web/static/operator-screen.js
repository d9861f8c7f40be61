// What stands on the operator's screen in each of its five states. Regions are made anew only when what they show has
// changed; readings and times move within them.
"use strict";
const ScreenView = (() => {
  const { begin, texts, h, svg, icon, SYMBOLS, fill, list, clock, seconds, moment, day, say, gauges, limitBar, fit } = Parts;
  const byId = (id) => document.getElementById(id);
  const may = { run: "csrf" in document.body.dataset, again: "again" in document.body.dataset };
  const made = {}, live = {};
  const primary = (words, name, extra = {}) => may.run && h("button", { type: "button", id: "primary", class: `primary${words.length > 12 ? " long" : ""}`, ...extra }, icon(name), h("span", {}, words), h("kbd", {}, "F2"));
  const second = (id, words, name) => may.run && h("button", { type: "button", id, class: "second" }, icon(name), words);
  const picture = (plan, number) => h("div", { class: "picture" }, number === null || number === undefined ? "" : svg(plan.pictures[number]));

  /** Puts children into a region when its signature is another one; whether it did. */
  function put(region, signature, children) {
    const key = JSON.stringify(signature);
    if (made[region] === key) return false;
    made[region] = key;
    byId(region).replaceChildren(...children().flat().filter(Boolean));
    return true;
  }

  const nestsOf = (state) => begin.nests.map((name) => [name, state[`nest ${name}`] || { serial: "" }]);
  const cellOf = (state, plan) => plan.cells[(state.line || {}).cell] || null;
  /** How units lie while they are put in: the fixture waits level, as it parks. */
  const seated = (plan) => plan.cells.find((c) => c.kind === "stop" && c.up === "+z") || plan.cells.find((c) => c.kind === "stop");
  const hand = (cell) => ["turn", "base", "temperature", "filter", "motors"].includes(cell.kind);
  const cellName = (cell) => (cell.kind === "stop" ? cell.name : texts[`cell_${cell.kind}`]);
  const isRunning = (state) => state.running;

  // ---- the left side -------------------------------------------------------------------------------------------

  const TASKS = {
    scan(state) {
      const { turn, again } = state.view, waiting = Object.keys(state.waiting);
      return [
        h("h2", {}, turn ? fill("scan_for", { nest: turn }) : texts.ready),
        h("p", { class: "lead" }, fill("scan_how", { nest: turn })),
        h("div", { class: "picture" }, svg(SCENE)),
        may.run && h("form", { id: "scan-form", class: "scanbox" }, icon("identify"), h("input", { id: "scan", "aria-label": texts.serial, placeholder: texts.scan_or_type, autocomplete: "off", autocapitalize: "off", spellcheck: "false", maxlength: "200" })),
        may.run && waiting.length ? second("start", fill("start_with", { units: waiting.length }), "play") : null,
        may.run && again.length && !waiting.length ? second("resume", fill("measure_again", { nests: list(again) }), "again") : null,
        may.run && h("p", { class: "hint" }, waiting.length ? texts.scan_fewer : texts.scan_anywhere),
      ];
    },
    ready(state, plan) {
      const first = seated(plan);
      return [
        h("h2", {}, fill("ready_units", { units: Object.keys(state.waiting).length })),
        h("p", { class: "lead" }, texts.ready_how),
        picture(plan, first ? first.picture : null),
        primary(texts.start, "play"),
        may.run && h("p", { class: "hint" }, texts.ready_card),
      ];
    },
    running(state, plan) {
      const cell = cellOf(state, plan), line = state.line || {};
      const heading = (words, more) => h("div", { class: "row" }, h("h2", { id: "now" }, words), more ? h("b", {}, more) : "");
      if (state.stopping) return [heading(texts.stopping), h("p", { class: "lead" }, texts.stopping_how)];
      if (!cell || !state.phase || state.phase === "begin") return [heading(texts.phase_begin), h("div", { class: "picture bigicon" }, icon("identify"))];
      if (cell.kind === "warm-up") return [heading(texts.cell_warm), h("p", { class: "lead" }, texts.warm_how), h("div", { class: "picture bigicon" }, icon("heat")), h("p", { class: "countdown", id: "warm" })];
      if (cell.kind !== "stop" && cell.kind !== "verify") return [heading(texts[`phase_${state.phase}`] || cellName(cell)), h("p", { class: "lead" }, texts.hands_off), h("div", { class: "picture bigicon" }, icon(cell.kind === "identify" ? "identify" : "write"))];
      const stops = plan.cells.filter((c) => c.kind === "stop"), next = plan.cells[line.cell + 1];
      const upward = cell.up && h("div", { class: "upward" }, svg('<svg viewBox="0 0 56 130" aria-hidden="true"><path class="solid" d="M28 0l27 46H38v84H18V46H1z"/></svg>'), h("span", {}, fill("axis_up", { axis: cell.up })));
      return [
        heading(cellName(cell), cell.kind === "stop" ? fill("position_of", { number: stops.indexOf(cell) + 1, total: stops.length }) : ""),
        h("div", { class: "pose" }, picture(plan, cell.picture), upward || h("span")),
        next && h("div", { class: "following" }, cellPicture(plan, next), h("div", {}, h("small", { class: "hint", id: "next-in" }, texts.next), h("strong", {}, cellName(next)), h("span", { class: "hint" }, hand(next) ? texts.your_turn_next : texts.hands_off))),
      ];
    },
    act(state, plan) {
      const badge = (words, name) => h("p", { class: "badge" }, icon(name), words);
      if (state.view.why === "fault") {
        const again = state.view.again;
        return [
          badge(texts.stopped_badge, "warn"), h("h2", {}, texts.run_stopped), h("p", { class: "lead", id: "fault" }, state.fault),
          h("div", { class: "picture bigicon" }, icon("warn")),
          h("div", { class: "deed" }, again.length ? primary(fill("measure_again", { nests: list(again) }), "again") : primary(texts.understood, "check"), h("p", { class: "hint" }, again.length ? texts.or_scan_others : texts.then_scan)),
        ];
      }
      if (state.view.why === "turn") {
        const cell = cellOf(state, plan);
        return [
          badge(texts.your_turn, "hand"), h("h2", { id: "instruction" }, state.instruction), cell && picture(plan, cell.picture),
          h("p", { class: "lead" }, texts.hold_still), h("p", { class: "note", id: "note", role: "status" }, state.note || ""),
        ];
      }
      const { title, confirm, angle, kind } = state.confirm || {}, cell = plan.cells.find((c, i) => i === state.line.cell) || {};
      const turn = cell.kind === "turn" && kind === "turn";
      const scene = turn
        ? h("div", { class: "turn" }, h("figure", {}, svg(plan.pictures[cell.before]), h("figcaption", {}, texts.now)), h("div", { class: "arrow" }, angle || "", svg('<svg viewBox="0 0 130 90" aria-hidden="true"><path class="solid" d="M0 32h72V4l58 41-58 41V58H0z"/></svg>')), h("figure", {}, svg(plan.pictures[cell.picture]), h("figcaption", {}, texts.then)))
        : h("div", { class: "picture bigicon" }, icon(kind === "temperature" ? "heat" : kind === "motors" ? "motor" : "hand"));
      return [
        badge(texts.your_turn, "hand"), h("h2", { id: "confirm" }, title || confirm), scene,
        h("div", { class: "deed" }, primary(texts.confirm, "check"), turn && h("ol", { class: "steps" }, ["turn_step_1", "turn_step_2", "turn_step_3"].map((k) => h("li", {}, h("span", {}, texts[k]))))),
      ];
    },
    done(state) {
      const nests = nestsOf(state), by = (test) => nests.filter(([, n]) => n.serial && test(n.outcome)).map(([name]) => name);
      const passed = by((o) => o === "PASS"), failed = by((o) => o === "FAIL"), again = by((o) => o && o !== "PASS" && o !== "FAIL");
      const good = passed.length ? fill("passed_tray", { count: passed.length, nests: list(passed) }) : "";
      const passedLine = (words) => words && h("p", { class: "passed" }, good ? icon("check") : "", words);
      const line = (words, name, tone) => [h("div", { class: words.length > 60 ? "row long" : "row" }, h("h2", { class: tone }, icon(name), " ", words))];
      byId("task").dataset.tone = failed.length ? "fail" : again.length ? "again" : "pass";
      if (failed.length) {
        const only = failed.length === 1 ? state[`nest ${failed[0]}`] : null;
        const why = only && (only.tile ? `${only.tile.head}, ${only.tile.line}` : (only.reasons || [])[0]) || "";
        const more = again.length ? fill("not_measured", { nests: list(again) }) : "";
        return [passedLine([good, more].filter(Boolean).join(" · ")), line(fill(why && why.length < 70 ? "remove_why" : "remove", { nests: list(failed), why }), "cross")];
      }
      if (again.length) return [passedLine(good), line(fill("not_measured", { nests: list(again) }), "warn")];
      return [line(fill("all_passed", { count: passed.length }), "check")];
    },
  };
  const SCENE = '<svg class="scene" viewBox="0 0 420 250" aria-hidden="true"><path class="beam" d="M140 92L232 42V170z"/><path class="gun" d="M20 52q16-10 60-10h42q14 0 14 14v44q0 14-14 14H96l14 92q2 12-10 12H66q-10 0-12-12L36 118Q18 104 18 88z"/><path class="dark" d="M124 60h14v36h-14zM78 122h10v20h-10z"/><path class="ray" d="M140 80h104"/><rect class="card" x="228" y="10" width="176" height="200" rx="8"/><path class="bars" d="M250 36h4v116h-4zM258 36h3v116h-3zM268 36h8v116h-8zM280 36h4v116h-4zM290 36h3v116h-3zM298 36h7v116h-7zM312 36h4v116h-4zM322 36h8v116h-8zM336 36h3v116h-3zM344 36h6v116h-6zM356 36h3v116h-3zM364 36h7v116h-7zM376 36h4v116h-4zM260 168h112v7H260zM260 184h74v7h-74z"/></svg>';
  /** Names of so many letters stand beside each other under the time line. */
  const LETTERS = 110;
  const cellPicture = (plan, cell) => cell.kind === "stop" ? picture(plan, cell.picture) : h("div", { class: "picture" }, icon({ identify: "identify", write: "write", verify: "verify", "warm-up": "heat", turn: "hand", base: "hand", filter: "hand", temperature: "heat", motors: "motor" }[cell.kind]));

  function task(state, plan) {
    const { view } = state;
    const signature = [view, state.line && view.state !== "scan" ? state.line.cell : 0, state.phase, state.stopping, state.confirm, state.instruction, state.note, state.fault, Object.keys(state.waiting), plan.id, view.state === "done" && nestsOf(state), made.language];
    if (view.state !== "done") delete byId("task").dataset.tone;
    const typed = byId("scan") ? byId("scan").value : "";
    const anew = put("task", signature, () => TASKS[view.state](state, plan));
    if (anew && (view.state === "ready" || view.why === "question")) fit([...byId("task").querySelectorAll(".turn figure svg, .picture svg[role=img]")]);
    if (anew && typed && byId("scan")) byId("scan").value = typed;
    return anew;
  }

  // ---- the nests -----------------------------------------------------------------------------------------------

  const letter = (name) => h("span", { class: "letter" }, name);
  function serial(text) {
    return h("p", { class: "serial", "data-part": "serial", "--len": Math.max(6, text.length) }, text.slice(0, -3), h("b", {}, text.slice(-3)));
  }
  const attempt = (nest) => nest.attempts ? h("span", { class: "try" }, fill("nth_try", { number: nest.attempts + 1 })) : "";
  const coming = (nest, state) => state.running && may.run ? h("p", { class: `coming${nest.next ? " filled" : ""}` }, icon(nest.next ? "check" : "identify"), h("span", {}, texts.next_unit, " ", h("b", { "data-part": "next" }, nest.next || texts.scan_ahead))) : "";

  function nestBox(name, nest, state, plan) {
    const look = state.view.state, box = (options, ...children) => h("article", { class: "nest", "data-nest": name, "aria-label": `${texts.nest} ${name}`, ...options }, ...children);
    delete live[name];
    if (nest.outcome) return box({ "data-outcome": nest.outcome }, verdict(name, nest), look === "done" ? null : coming(nest, state));
    if (!nest.serial) {
      const turn = look === "scan" && state.view.turn === name;
      if (look === "scan") return box({ "data-look": turn ? "turn" : "empty" }, letter(name), h("p", {}, fill("scan_for", { nest: name })));
      return box({ "data-look": "empty" }, letter(name), look === "running" ? coming(nest, state) : h("p", {}, texts.empty));
    }
    const head = [h("div", { class: "top" }, letter(name), attempt(nest)), serial(nest.serial)];
    if (look === "scan" || look === "ready") {
      const last = nest.last && nest.attempts ? h("p", { class: "past" }, fill("failed_at", { time: moment(nest.last.at_s) }), " ", h("b", {}, nest.last.reason)) : "";
      head[0].append(may.run ? h("button", { type: "button", class: "out", "data-serial": nest.serial }, texts.take_out) : "");
      const heard = look === "ready" && hears(name, state), bars = gauges(state.unit), warmth = h("b");
      if (heard) live[name] = { bars, warmth };
      return box({}, head, h("p", { class: "good", "data-part": "verdict" }, icon("check"), heard ? texts.in_place : texts.scanned_in), last, heard ? [h("p", { class: "row warmth" }, texts.unit_at, warmth), bars.node] : look === "ready" && !last ? stepList(nest, state, plan).node : "");
    }
    if (look === "act") {
      const stops = plan.cells.filter((c) => c.kind === "stop").length;
      const turned = (state.confirm || {}).kind === "turn";
      return box({}, h("div", { class: "brief" }, letter(name), serial(nest.serial), attempt(nest)), h("div", { class: "row" }, h("p", { class: "hint" }, state.total ? fill("measured_of", { done: Math.min(state.done, stops), total: stops }) : ""), turned && h("p", { class: "yours" }, icon("again"), texts.turn_it)));
    }
    const bars = gauges(state.unit), steps = stepList(nest, state, plan);
    live[name] = { bars, steps };
    return box({}, h("div", { class: "compact" }, h("div", {}, head)), steps.node, bars.node, coming(nest, state));
  }

  /** identify, measure, write, verify: durations where they are over, ≈ where they are expected. */
  function stepList(nest, state, plan) {
    const names = ["identify", "measure", "write", "verify"], took = nest.took_s || [], expected = state.line.expected_s || [];
    const sum = (kinds) => plan.cells.reduce((s, c, i) => s + (kinds.includes(c.kind) ? expected[i] || 0 : 0), 0);
    const ahead = { identify: sum(["identify"]), measure: sum(["stop", "warm-up"]), write: sum(["write"]), verify: sum(["verify"]) };
    const verified = plan.cells.some((c) => c.kind === "verify");
    const at = nest.step ? names.indexOf(nest.step) : nest.scanned ? 0 : took.length;
    const count = h("span");
    const rows = names.filter((name) => name !== "verify" || verified).map((name, i) => {
      const is = i < at ? "done" : i === at && nest.step ? "now" : "next", time = h("span", { class: "took" }, is === "done" ? seconds(took[i] || 0) : is === "next" ? `≈ ${seconds(ahead[name])}` : "");
      const words = h("span", {}, texts[`step_${name}`], name === "measure" && is === "now" ? count : "");
      return { is, time, node: h("li", { "data-is": is, "aria-current": is === "now" ? "step" : null }, icon({ done: "check", now: "going", next: "todo" }[is]), words, time) };
    });
    const now = rows.find((r) => r.is === "now");
    const show = (now_s, done, total) => {
      if (now) say(now.time, seconds(Math.max(0, now_s - (nest.since_s || now_s))));
      say(count, total ? ` ${done}/${total}` : "");
    };
    return { node: h("ul", { class: "plan" }, rows.map((r) => r.node)), show };
  }

  function verdict(name, nest) {
    const words = texts[`tile_${nest.outcome}`] || nest.outcome, tile = nest.tile, cjk = /[⺀-鿿]/.test(words);
    const to = nest.outcome === "PASS" ? "green" : nest.outcome === "FAIL" ? "red" : "again";
    const reasons = nest.reasons || [];
    return [
      h("div", { class: "verdict", "data-part": "verdict", "data-outcome": nest.outcome, role: "status" }, h("div", { class: "top" }, letter(name), serial(nest.serial), icon(SYMBOLS[nest.outcome])), h("strong", { class: cjk ? "cjk" : null, "--letters": Math.max(3, words.length) }, words)),
      h("div", { class: "why", "data-part": "reasons" }, nest.outcome === "PASS" ? h("b", {}, texts.written_verified) : "", tile ? [nest.outcome === "PASS" ? h("p", {}, tile.head, ", ", tile.line) : [h("b", {}, tile.head), h("p", {}, tile.line)]] : h("ul", {}, reasons.map((r) => h("li", {}, r)))),
      tile ? limitBar(tile.bar, `${tile.head}, ${tile.line}`) : "",
      h("p", { class: "bin", "data-to": to }, icon(to === "again" ? "again" : "to"), texts[`to_${to}`]),
    ];
  }

  function nests(state, plan) {
    const region = byId("nests"), many = begin.nests.length > 4;
    region.style.setProperty("--columns", Math.min(4, begin.nests.length));
    region.toggleAttribute("data-many", many);
    const names = begin.nests.map((name) => `nest ${name}`);
    const anew = put("nests", [state.view, names.map((n) => state[n]), plan.id, state.unit, state.view.state === "act" && state.done, (state.line || {}).expected_s && state.running, state.view.state === "ready" && begin.nests.map((n) => hears(n, state))], () => nestsOf(state).map(([name, nest]) => nestBox(name, nest, state, plan)));
    readings(state, plan);
    return anew;
  }

  const hears = (name, state) => (state[`live ${name}`] || []).length > 0;

  /** What is scanned for the loads after the next, each with its time: where the next one is made ready or measured. */
  function queue(state) {
    const rows = ["scan", "ready", "running"].includes(state.view.state) ? state.queue : [];
    byId("queue").hidden = !rows.length;
    const out = (serial) => may.run && h("button", { type: "button", class: "out", "data-serial": serial, title: texts.take_out, "aria-label": `${texts.take_out} ${serial}` }, icon("cross"));
    put("queue", [rows], () => [
      h("h2", {}, texts.queue, h("small", {}, fill("queue_units", { units: rows.flat().length }))),
      h("ol", {}, rows.map((row) => h("li", {}, h("span", { class: "when" }), row.map((serial) => h("span", { class: "waits" }, h("b", {}, serial), out(serial)))))),
    ]);
  }

  /** When the loads of the queue begin, the present or next one ending at ends_s. */
  function queueTimes(ends_s, each_s, running) {
    byId("queue").querySelectorAll(".when").forEach((node, i) => say(node, fill("about", { time: moment(ends_s + (i + (running ? 1 : 0)) * each_s) })));
  }

  function readings(state, plan) {
    const cell = state.running ? cellOf(state, plan) : seated(plan), expected = cell && cell.true, full = 1.2 * Math.max(1e-9, ...plan.cells.flatMap((c) => (c.true || []).map(Math.abs)));
    for (const [name, { bars, warmth }] of Object.entries(live)) {
      const now = state[`live ${name}`] || [];
      bars.show(now.slice(0, 3), expected, full);
      if (warmth) { say(warmth, now.length > 3 ? `${now[3].toFixed(1)} °C` : ""); warmth.parentNode.hidden = now.length < 4; }
    }
  }

  // ---- the foot ------------------------------------------------------------------------------------------------

  function foot(state, plan) {
    const look = state.view.state, line = state.line || {}, stop = state.running && !state.stopping;
    // The Stop button stays the same element for the whole run: a press must not get lost when the next position begins.
    put("halt", [stop], () => [stop && may.run && h("button", { type: "button", id: "stop", class: "stop" }, icon("square"), texts.stop)]);
    const signature = [look, plan.id, line.cell, look === "done" && [state.view, state.waiting], state.running, may];
    return put("foot", signature, () => {
      if (look === "done") return doneFoot(state);
      const box = h("div", { class: "clockbox" }, h("small", { id: "left-name" }), h("strong", { id: "left" }), h("span", { class: "more", hidden: true }, icon("hand"), h("span", { id: "left-more" })));
      const cells = plan.cells.map((cell, i) => h("li", { "data-is": i < line.cell ? "done" : i === line.cell ? "now" : "next", "data-hand": hand(cell) || null, "aria-current": i === line.cell ? "step" : null, title: cellName(cell) },
        cell.kind === "stop" ? svg(plan.pictures[cell.picture]) : cellPicture(plan, cell).firstElementChild, h("span", { class: "name" }, cellName(cell)), h("span", { class: "track", "aria-hidden": "true" }, h("i", i === line.cell ? { id: "track" } : {}))));
      const letters = plan.cells.reduce((sum, cell) => sum + cellName(cell).length, 0);
      return [box, h("ol", { class: `line${letters > LETTERS ? " tight" : ""}${cells.length > 22 ? " dense" : ""}`, "aria-label": texts.progress }, cells)];
    });
  }

  function doneFoot(state) {
    const { bin, again } = state.view, next = Object.entries(state.waiting);
    const button = bin.length ? primary(fill("in_bin", { nests: list(bin) }), "check") : again.length ? primary(fill("measure_again", { nests: list(again) }), "again") : primary(texts.next_load, "play");
    const words = next.length ? [texts.then_load, " ", h("b", { id: "coming" }, next.map(([nest, s]) => `${nest}: ${s}`).join(" · "))] : [bin.length ? texts.then_scan : texts.or_scan];
    return [button || h("span"), h("p", { class: "then" }, words)];
  }

  /** When a person is needed: the line under the time. */
  function more(words) {
    const line = byId("left-more");
    say(line, words);
    if (line) line.parentNode.hidden = !words;
  }

  /** What moves with the clock alone. */
  function times(state, plan, now_s) {
    const line = state.line || {}, at = line.cell, expected = line.expected_s || [], cell = plan.cells[at];
    say(byId("clock"), moment(now_s)); say(byId("date"), day(now_s));
    if (state.view.state === "done") return;
    const total = expected.reduce((s, e, i) => s + (hand(plan.cells[i]) ? 0 : e), 0);
    if (!state.running) {
      say(byId("left-name"), texts.run_takes); say(byId("left"), clock(total));
      const hands = plan.cells.filter(hand).length, first = plan.cells.findIndex(hand);
      const until = clock(expected.slice(0, Math.max(0, first)).reduce((s, e, i) => s + (hand(plan.cells[i]) ? 0 : e), 0));
      queueTimes(now_s + total, total, false);
      more(hands ? fill(hands > 1 ? "your_turns" : "your_turn_once", { count: hands, time: until }) : "");
      return;
    }
    const within = line.cell_since_s ? now_s - line.cell_since_s : 0;
    const present = !cell || hand(cell) ? 0 : line.warm_until_s ? Math.max(0, line.warm_until_s - now_s) : Math.max(0, (expected[at] || 0) - within);
    const ahead = (until) => plan.cells.slice(at + 1, until).reduce((s, c, i) => s + (hand(c) ? 0 : expected[at + 1 + i] || 0), present);
    const turn = plan.cells.findIndex((c, i) => i > at && hand(c)), waits = state.view.state === "act" && state.view.why === "question";
    say(byId("left-name"), waits ? texts.left_after : texts.time_left);
    say(byId("left"), cell || at < 0 ? clock(ahead(plan.cells.length)) : clock(0));
    more(waits ? fill("waiting_you", { time: clock(within) }) : turn > 0 ? fill("your_turn_in", { time: clock(ahead(turn)) }) : "");
    queueTimes(now_s + ahead(plan.cells.length), total, true);
    const track = byId("track");
    if (track) track.style.width = `${Math.min(100, (100 * within) / Math.max(0.1, expected[at] || 1))}%`;
    say(byId("warm"), clock(Math.max(0, (line.warm_until_s || 0) - now_s)));
    const next = byId("next-in");
    if (next) say(next, present >= 1 ? fill("next_in", { seconds: Math.ceil(present) }) : texts.next);
    const stops = plan.cells.filter((c) => c.kind === "stop");
    for (const { steps } of Object.values(live)) steps.show(now_s, Math.max(0, stops.indexOf(cell) + 1), stops.length);
  }

  function head(state) {
    const { today, bus, view } = state, [name, version] = (state.recipe || "").split("/");
    say(byId("recipe"), [`${name} v${version || ""}`, state.product].filter(Boolean).join(" · "));
    say(byId("count-today"), String(today.units));
    say(byId("yield"), today.yield === null ? "–" : `${(100 * today.yield).toFixed(1)} %`);
    say(byId("cycle"), today.cycle_s === null ? "–" : clock(today.cycle_s + 0.5));
    const wrong = Boolean(bus.name) && !["active", "unknown"].includes(bus.state), counters = bus.counters;
    say(byId("bus"), !bus.name ? "–" : `${wrong ? "⚠" : "✔"} ${texts[`bus_${bus.state}`] || bus.state}`);
    byId("bus").title = counters ? `${bus.name}: ${texts.bus_sending} ${counters.sending}, ${texts.bus_receiving} ${counters.receiving}` : bus.name || "";
    byId("bus").classList.toggle("problem", wrong);
    byId("light").dataset.lamp = view.lamp; byId("light").setAttribute("aria-label", `${texts.stack_light}: ${texts[`lamp_${view.lamp}`]}`);
    const { outer } = state; byId("outer").hidden = !outer.state;
    if (outer.state) say(byId("outer-state"), [texts[`line_${outer.state}`], outer.load ? fill("line_load", outer) : "", fill("line_loads", outer)].filter(Boolean).join(" · "));
    byId("held").hidden = !state.held; say(byId("held"), state.held ? `⚠ ${state.held}` : "");
    byId("shipping").hidden = !state.shipping; say(byId("shipping"), state.shipping ? `⚠ ${state.shipping}` : "");
    byId("watch").hidden = !state.watch; say(byId("watch"), state.watch ? `⚠ ${state.watch}` : "");
    byId("golden").hidden = !state.golden; say(byId("golden"), state.golden ? `⚠ ${state.golden}` : "");
  }

  return { head, task, nests, queue, foot, times, readings, isRunning, may };
})();
